"""Frames and frame sources, independent of the transport, and the coding of image files."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import CatoptraError, RemoteProtocolError
from catoptra_protocol.labels import GroundTruth
from catoptra_protocol.limits import MAX_IMAGE_PIXELS
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.replies import DifferenceRecord, EffectRecord, PlanAlternative
from catoptra_protocol.usarsim.image_port import ImageType, parse_jpeg_size

# EXIF orientation is ignored: rotating the image would invalidate the camera model.
_IMREAD_FLAGS = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
# Signature, length and type of the first chunk, whose first eight bytes are width and height.
_PNG_HEADER = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR"

Pixels = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class LabelledPixels:
    """Ground truth of a frame's pixels."""

    truth: GroundTruth
    """Channels by name, and the objects in view."""
    has_row_times: bool
    """Whether each row of pixels has its own time (rolling shutter), else all that of the frame."""
    is_displaced: bool
    """Whether the labels are of a displaced capture camera, as the picture is."""
    flow_to_time_s: float | None
    """Simulated time of the frame that the flow leads to; None without one."""


# eq=False: comparing arrays gives an array, so frames compare by identity.
@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Frame:
    """One image with its metadata, from either transport.

    TCP delivers image, sequence and type alone; the other fields are then None or empty. `print`
    shows a summary, a notebook the picture.
    """

    rgb: Pixels
    """Pixels (h, w, 3) uint8 RGB, read-only; empty if the server had nothing to show."""
    sequence: int
    """Number of the frame: per connection over TCP, per server over the stream."""
    received_s: float
    """Client clock when the last byte had arrived."""
    image_type: ImageType
    """Encoding on the wire; RAW for any lossless one."""
    robot_name: str | None = None
    """Name of the robot that carries the camera."""
    camera_name: str | None = None
    """Name of the camera."""
    time_s: float | None = None
    """Simulated time of the exposure."""
    world_from_robot: Pose | None = None
    """Pose of the robot at the exposure."""
    camera: OmniCamera | PerspectiveCamera | None = None
    """Camera model of the pixels."""
    robot_from_mirror: Pose | None = None
    """Pose of the camera's viewpoint or pinhole on the robot."""
    stage_ms: Mapping[str, float] | None = None
    """Server time per rendering stage, in milliseconds."""
    age_s: float | None = None
    """Time from exposure to sending."""
    missed_frames: int | None = None
    """Frames rendered but not sent to this client, in total."""
    dropped_frames: int | None = None
    """Frames requested by this client but not taken, in total."""
    plan: str | None = None
    """Render plan, by name."""
    error_bound_px: float | None = None
    """Bound on the displacement of any outline, in pixels."""
    error_bounds: dict[str, float] | None = None
    """Total and partial bounds by name, as listed in SPEC.md."""
    effects: tuple[EffectRecord, ...] = ()
    """Decision about each effect that the robot file names."""
    predicted_ms: float | None = None
    """Predicted duration of a frame of this plan; None without an accuracy target."""
    more_accurate: PlanAlternative | None = None
    """Next more accurate plan, likewise."""
    faster: PlanAlternative | None = None
    """Next cheaper plan, likewise."""
    difference: DifferenceRecord | None = None
    """Difference from the reference that a variant names, in numbers."""
    difference_rgb: Pixels | None = None
    """The same as (h, w, 3) absolute differences, uint8."""
    labels: LabelledPixels | None = None
    """Channels of ground truth and the objects in view, where they were requested."""

    def __repr__(self) -> str:
        """Summary in a line: of the fields that the transport delivers, those of interest."""
        height, width = self.rgb.shape[:2]
        parts = [f"{width} x {height} px" if self.rgb.size else "no pixels"]
        if self.camera_name is not None:
            parts.append(f"camera {self.camera_name!r}")
        if self.robot_name is not None:
            parts.append(f"robot {self.robot_name!r}")
        if self.time_s is not None:
            parts.append(f"at {self.time_s:.2f} s")
        if self.error_bound_px is not None:
            parts.append(f"bound {self.error_bound_px:.2g} px")
        if self.plan is not None:
            # The server's name of a plan, then its reason.
            parts.append(self.plan.partition(":")[0])
        if self.stage_ms is not None:
            parts.append(f"rendered in {sum(self.stage_ms.values()):.1f} ms")
        return f"<Frame {self.sequence}: {', '.join(parts)}>"

    def _repr_png_(self) -> bytes | None:
        """PNG file for a notebook; None without pixels."""
        return image_bytes_from_rgb(self.rgb, ".png") if self.rgb.size else None

    def _repr_html_(self) -> str:
        """Picture above its summary, for a notebook."""
        caption, png = html.escape(repr(self)), self._repr_png_()
        if png is None:
            return f"<p>{caption}</p>"
        data = base64.b64encode(png).decode("ascii")
        return f'<img src="data:image/png;base64,{data}" alt="{caption}"><p>{caption}</p>'


class FrameSource(Protocol):
    """Interface of the frame sources of both transports.

    Waiting raises ConnectionLostError or DeadlineExceededError.
    """

    def get_frame(self) -> Frame:
        """Newest frame."""

    def iter_frames(self) -> Iterator[Frame]:
        """Iterate over frames without end."""

    def close(self) -> None:
        """Close the connection."""

    def __enter__(self) -> FrameSource:
        """Enter a context that closes the source on exit."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the connection."""


def rgb_from_image_bytes(data: bytes) -> Pixels:
    """Decode a JPEG or PNG file to (h, w, 3) uint8 RGB.

    Raises:
        RemoteProtocolError: the file is invalid, or larger than `MAX_IMAGE_PIXELS`; the size is
            checked before memory is allocated.
    """
    # All other data is treated as JPEG, whose header check reports anything else.
    kind = "PNG" if data.startswith(_PNG_HEADER) else "JPEG"
    if kind == "PNG":
        _check_png_size(data)
    else:
        parse_jpeg_size(data)
    # OpenCV reports some invalid files by an exception and others by None.
    try:
        rgb = cv2.imdecode(np.frombuffer(data, np.uint8), _IMREAD_FLAGS)
    except cv2.error as error:
        raise RemoteProtocolError(f"{kind} frame that cannot be decoded: {error}") from error
    if rgb is None:
        raise RemoteProtocolError(f"{kind} frame of {len(data)} bytes that cannot be decoded")
    return np.asarray(rgb, np.uint8)


def image_bytes_from_rgb(rgb: Pixels, suffix: str) -> bytes:
    """Encode (h, w, 3) RGB pixels as an image file of the format with this suffix.

    Raises:
        CatoptraError: there are no pixels.
    """
    if not rgb.size:
        raise CatoptraError("the frame has no pixels: spawn a robot with a camera first")
    bgr = cv2.cvtColor(np.ascontiguousarray(rgb), cv2.COLOR_RGB2BGR)
    # Two thirds of the size of OpenCV's default.
    options = [cv2.IMWRITE_PNG_COMPRESSION, 6] if suffix == ".png" else []
    ok, data = cv2.imencode(suffix, bgr, options)
    assert ok, "cv2 encodes every 8-bit image"
    encoded: bytes = data.tobytes()
    return encoded


def _check_png_size(data: bytes) -> None:
    size = data[len(_PNG_HEADER) : len(_PNG_HEADER) + 8]
    width, height = int.from_bytes(size[:4], "big"), int.from_bytes(size[4:], "big")
    if width * height > MAX_IMAGE_PIXELS:
        raise RemoteProtocolError(
            f"PNG frame of {width} x {height} px: the limit is {MAX_IMAGE_PIXELS} pixels"
        )
