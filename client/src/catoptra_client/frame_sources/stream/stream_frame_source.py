"""Frames of one selected camera over the stream, as a `FrameSource`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from catoptra_client.frame import Frame
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.stream.requests import FrameVariant, ImageEncoding


@dataclass(frozen=True, slots=True)
class CameraSelection:
    """Camera and encoding of a frame source.

    Two empty names select the image-port picture, one empty name a robot's first camera.
    """

    robot: str = ""
    camera: str = ""
    encoding: ImageEncoding = ImageEncoding.JPEG
    """JPEG is small, PNG and RAW are lossless."""
    picture: str = ""
    """`mirrored` or `flipped`, of an omnidirectional camera; empty: as the camera has it."""


class StreamFrameSource:
    """Frames of one camera; the source owns its client and closes it.

    Waiting calls raise CatoptraError with the server's reason if there is no such robot or camera
    (any more), ConnectionLostError and DeadlineExceededError as in `StreamClient`.
    """

    def __init__(self, client: StreamClient, selection: CameraSelection) -> None:
        self.client = client
        self.selection = selection

    def get_frame(self) -> Frame:
        """Request the newest frame and wait."""
        selected = self.selection
        return self.client.get_frame(
            encoding=selected.encoding,
            robot=selected.robot,
            camera=selected.camera,
            variant=FrameVariant(picture=selected.picture) if selected.picture else None,
        )

    def iter_frames(self) -> Iterator[Frame]:
        """Iterate over newest frames for ever."""
        # Requested when the consumer advances, not ahead: each frame is the newest at that moment.
        while True:
            yield self.get_frame()

    def close(self) -> None:
        """End the connection."""
        self.client.close()

    def __enter__(self) -> StreamFrameSource:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()
