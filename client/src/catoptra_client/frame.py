"""A picture that came, whatever brought it; what brings pictures; and how files become pixels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

import cv2
import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.limits import MAX_IMAGE_PIXELS
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.replies import EffectRecord
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_protocol.usarsim.jpeg_header import parse_jpeg_size

_IMREAD_FLAGS = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
_PNG_HEADER = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"

Pixels = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One picture: (h, w, 3) uint8 RGB, read-only; empty if the server had nothing to show.

    sequence: counts frames, of the connection over TCP, of the server over the stream. received_s:
    by the client's clock, when its last byte had come. image_type: RAW for whatever is lossless.

    Only the stream tells the rest; None elsewhere. time_s, world_from_robot: of the exposure.
    camera: the law of its pixels; robot_from_mirror: where its viewpoint sits. age_s: from exposure
    to sending. missed: frames drawn that this client was not sent, in all. dropped: frames that it
    asked for and did not take. plan, error_bound_px: how it was drawn, and how far
    off any outline may be; bound: that and its parts by name, as SPEC.md has them.
    effects: what was decided about each that the robot's file names; empty where none is told.
    """

    rgb: Pixels
    sequence: int
    received_s: float
    image_type: ImageType
    robot_name: str | None = None
    camera_name: str | None = None
    time_s: float | None = None
    world_from_robot: Pose | None = None
    camera: OmniCamera | PerspectiveCamera | None = None
    robot_from_mirror: Pose | None = None
    stage_ms: Mapping[str, float] | None = None
    age_s: float | None = None
    missed_frames: int | None = None
    dropped_frames: int | None = None
    plan: str | None = None
    error_bound_px: float | None = None
    error_bounds: dict[str, float] | None = None
    effects: tuple[EffectRecord, ...] = ()


class FrameSource(Protocol):
    """What both transports offer. Waiting raises ConnectionLostError or DeadlineExceededError."""

    def get_frame(self) -> Frame:
        """Return the newest frame."""

    def iter_frames(self) -> Iterator[Frame]:
        """Iterate over frames for ever."""

    def close(self) -> None:
        """End the connection."""

    def __enter__(self) -> Self:
        """Return itself."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close."""


def rgb_from_image_bytes(data: bytes) -> Pixels:
    """Return the (h, w, 3) uint8 RGB picture of a JPEG or PNG file.

    Raises RemoteProtocolError if it is none, or larger than we accept: before memory is taken.
    """
    kind = "PNG" if data.startswith(_PNG_HEADER) else "JPEG"
    if kind == "PNG":
        _check_png_size(data)
    else:
        parse_jpeg_size(data)
    try:
        rgb = cv2.imdecode(np.frombuffer(data, np.uint8), _IMREAD_FLAGS)
    except cv2.error as error:
        raise RemoteProtocolError(f"{kind} frame that cannot be decoded: {error}") from error
    if rgb is None:
        raise RemoteProtocolError(f"{kind} frame of {len(data)} bytes that cannot be decoded")
    return np.asarray(rgb, np.uint8)


def _check_png_size(data: bytes) -> None:
    size = data[len(_PNG_HEADER) : len(_PNG_HEADER) + 8]
    width, height = int.from_bytes(size[:4]), int.from_bytes(size[4:])
    if width * height > MAX_IMAGE_PIXELS:
        raise RemoteProtocolError(
            f"PNG frame of {width} x {height} px: more than the {MAX_IMAGE_PIXELS} that we accept"
        )
