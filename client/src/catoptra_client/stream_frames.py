"""One camera's frames over the stream, as a `FrameSource`: which camera is said once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Self

from catoptra_client.frame import Frame
from catoptra_client.stream import StreamClient
from catoptra_protocol.wire.stream_requests import Encoding


@dataclass(frozen=True, slots=True)
class Watched:
    """What to look at: empty names take what the server's screen shows, or a robot's first camera.

    encoding: JPEG is small, PNG and RAW are exact.
    """

    robot: str = ""
    camera: str = ""
    encoding: Encoding = Encoding.JPEG


class StreamFrames:
    """Frames of one camera. Closing it closes the client that it was given.

    Waiting raises CatoptraError with the server's reason where there is no such robot or camera
    (any more), ConnectionLostError and ServerSlowError as `StreamClient` does.
    """

    def __init__(self, client: StreamClient, watched: Watched) -> None:
        self.client = client
        self.watched = watched

    def frame(self) -> Frame:
        """Return the newest frame."""
        is_ = self.watched
        return self.client.frame(encoding=is_.encoding, robot=is_.robot, camera=is_.camera)

    def frames(self) -> Iterator[Frame]:
        """Iterate over newest frames for ever."""
        while True:
            yield self.frame()

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
