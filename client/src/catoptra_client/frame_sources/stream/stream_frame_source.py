"""One camera's frames over the stream, as a `FrameSource`: which camera is said once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from catoptra_client.frame import Frame
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_protocol.stream.requests import ImageEncoding


@dataclass(frozen=True, slots=True)
class CameraSelection:
    """What to look at: empty names take what the server's screen shows, or a robot's first camera.

    encoding: JPEG is small, PNG and RAW are exact.
    """

    robot: str = ""
    camera: str = ""
    encoding: ImageEncoding = ImageEncoding.JPEG


class StreamFrameSource:
    """Frames of one camera. Closing it closes the client that it was given.

    Waiting raises CatoptraError with the server's reason where there is no such robot or camera
    (any more), ConnectionLostError and DeadlineExceededError as `StreamClient` does.
    """

    def __init__(self, client: StreamClient, selection: CameraSelection) -> None:
        self.client = client
        self.selection = selection

    def get_frame(self) -> Frame:
        """Return the newest frame."""
        is_ = self.selection
        return self.client.get_frame(encoding=is_.encoding, robot=is_.robot, camera=is_.camera)

    def iter_frames(self) -> Iterator[Frame]:
        """Iterate over newest frames for ever."""
        while True:
            yield self.get_frame()

    def close(self) -> None:
        """End the connection."""
        self.client.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
