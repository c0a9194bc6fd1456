"""Requests for frames, and the frames that answer: image, labels, numbers and payloads.

A request holds everything that the image depends on, frozen, so that the simulation goes on while
another thread renders. One frame may consist of several views, one for each tile. Payloads of image
and labels are encoded once for all connections. Frames know no renderer and no socket.

* A channel is the image-port picture, one tile of it, or one camera of one robot: each has a
  mailbox, a sequence and an interval of its own, and a tile requested alone is rendered alone.
* A variant of a camera is a channel, too: a viewer tries what accuracy and effects cost while the
  robot's own camera stays as its owner has set it.

Images are encoded here for both image transports; no other module of the server imports OpenCV. It
is loaded before the first JPEG or PNG can be requested, by `load_opencv`; RAW frames before
that are swapped by NumPy, in 0.7 ms at 640 x 640 px instead of 0.1.

Raw frames up to 4 MiB are encoded on the event loop, in 0.1 ms; other encodings take one worker
thread for all clients (`Frame.encode`). The rest of a frame's sending is the system's:
`sendfile` of a frame in memory took 1.2 times the time of one `send`, `splice` 1.6 times, with a
new file for each frame 2.9 times; other socket buffers changed nothing.
"""

from __future__ import annotations

import asyncio
import math
import zlib
from collections.abc import Mapping
from dataclasses import field, replace
from typing import Any

import numpy as np

from catoptra_protocol.camera_conf import Pairs
from catoptra_protocol.labels import Channels, GroundTruth, LabelledObject
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.requests import ChannelEncoding, ImageEncoding
from catoptra_protocol.usarsim.image_port import (
    JPEG_QUALITY,
    ImageType,
    encode_frame_header,
    encode_raw_header,
)
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.multi_view import TileLayout
from catoptra_server.frames.plan.camera import CameraSpec, CameraVariant
from catoptra_server.frames.plan.plans import PlanChoice
from catoptra_server.render.renderer import Image
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import Twist

Payload = bytes | memoryview
_FRAME_HEADER_BYTES = len(encode_frame_header(ImageType.GOOD, 0))
# Raw images up to this size take 0.1 ms, and a hop to another thread and back 0.4 ms of processor
# time; larger ones, and JPEG and PNG, would hold up the event loop.
_MAX_QUICK_BYTES = 4 * 2**20
# The module cv2; None until `load_opencv`.
_cv2: Any = None


def load_opencv() -> None:
    """Load OpenCV, which takes a tenth of a start."""
    global _cv2
    import cv2

    # One thread encodes: OpenCV's own pool would compete with the renderer's threads for the cores.
    cv2.setNumThreads(1)
    _cv2 = cv2


async def encode_without_blocking(rgb: Image, encoding: ImageType | ImageEncoding) -> Payload:
    """Encode an image for a transport, without holding up the event loop.

    Args:
        rgb: (h, w, 3) uint8.
        encoding: A type of USARSim's image port: JPEG of some quality, or RAW with header, B G R
            and padded rows. Or an encoding of the stream: raw R G B rows, JPEG or PNG.

    Returns:
        For the image port header and payload of the reply in one piece, so that one call sends
        both; for the stream the payload.
    """
    if is_quick(rgb, encoding):
        return encode_image(rgb, encoding)
    return await asyncio.to_thread(encode_image, rgb, encoding)


def is_quick(rgb: Image, encoding: ImageType | ImageEncoding) -> bool:
    """Whether an encoding of an image takes less time than a hop to another thread."""
    return encoding in (ImageType.RAW, ImageEncoding.RAW) and rgb.nbytes <= _MAX_QUICK_BYTES


def payload_of_reply(reply: Payload) -> memoryview:
    """Payload of a reply of the image port, without a copy."""
    return memoryview(reply)[_FRAME_HEADER_BYTES:]


def crop(rgb: Image, x: int, y: int, width: int, height: int) -> Image:
    """Part of an image inside a rectangle clamped to the image; at least one pixel."""
    rows, columns = rgb.shape[:2]
    # USARSim leaves a rectangle outside the image undefined; here its nearest pixel is returned.
    left, top = min(x, columns - 1), min(y, rows - 1)
    right = min(max(x + width, left + 1), columns)
    bottom = min(max(y + height, top + 1), rows)
    return rgb[top:bottom, left:right]


def encode_image(rgb: Image, encoding: ImageType | ImageEncoding) -> Payload:
    """Encode an image; for the arguments see `encode_without_blocking`."""
    if encoding is ImageEncoding.RAW:
        return np.ascontiguousarray(rgb).data.cast("B")
    # The stream does not choose a quality; GOOD is the image port's default.
    if encoding is ImageEncoding.JPEG:
        return payload_of_reply(encode_image(rgb, ImageType.GOOD))
    if encoding is ImageType.RAW:
        return _encode_raw(rgb)
    if _cv2 is None:
        load_opencv()
    bgr = _cv2.cvtColor(np.ascontiguousarray(rgb), _cv2.COLOR_RGB2BGR)
    if encoding is ImageEncoding.PNG:
        # Level 1: a third of the default's time for a tenth more bytes.
        return _encode_file(".png", bgr, [_cv2.IMWRITE_PNG_COMPRESSION, 1])
    file = _encode_file(".jpg", bgr, [_cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY[encoding]])
    return encode_frame_header(encoding, len(file)) + file


def _encode_raw(rgb: Image) -> memoryview:
    height, width = rgb.shape[:2]
    # The original server pads rows to four bytes, and clients differ: see SPEC-NOTES.md.
    row_bytes = 3 * width + -3 * width % 4
    raw_header = encode_raw_header(width, height)
    payload_bytes = len(raw_header) + height * row_bytes
    header = encode_frame_header(ImageType.RAW, payload_bytes) + raw_header
    # Converted into its place in the reply: 0.05 ms at 640 x 640 px, and 0.09 if joined afterwards.
    reply = np.empty(len(header) + height * row_bytes, np.uint8)
    reply[: len(header)] = np.frombuffer(header, np.uint8)
    rows = reply[len(header) :].reshape(height, row_bytes)
    rows[:, 3 * width :] = 0
    bgr = rows[:, : 3 * width].reshape(height, width, 3)
    if _cv2 is not None:
        _cv2.cvtColor(np.ascontiguousarray(rgb), _cv2.COLOR_RGB2BGR, dst=bgr)
    else:
        # Channel by channel: four times as fast as one copy of reversed pixels.
        for channel in range(3):
            bgr[..., channel] = rgb[..., 2 - channel]
    return reply.data


def _encode_file(suffix: str, bgr: Image, options: list[int]) -> bytes:
    ok, stream = _cv2.imencode(suffix, bgr, options)
    assert ok, "cv2 encodes every 8-bit image"
    payload: bytes = stream.tobytes()
    return payload


@dataclass(frozen=True, slots=True)
class ImagePortChannel:
    """The image of the image port, or one tile of a multi-view."""

    tile: int | None = None
    """Index of the tile; None for the whole image."""


@dataclass(frozen=True, slots=True)
class CameraChannel:
    """One camera of one robot, at the camera's own size."""

    robot: str
    """Name of the robot; empty for the robot that the image port displays."""
    camera: str
    """Name of the camera in any case; empty for the robot's first camera."""
    variant: CameraVariant | None = None
    """Other settings, of an omnidirectional camera; None for the camera's own."""


# Compared by value: channels are keys of mailboxes and of the scheduler.
Channel = ImagePortChannel | CameraChannel
IMAGE_PORT = ImagePortChannel()


def is_variant(channel: Channel) -> bool:
    """Whether a channel shows a camera by other settings than its own."""
    return isinstance(channel, CameraChannel) and channel.variant is not None


# eq=False here and below: states hold arrays, whose comparison is no truth value.
@dataclass(frozen=True, slots=True, eq=False)
class Carrier:
    """Motion of a robot that carries a camera."""

    world_from_robot: Pose
    twist: Twist
    """Mean motion in the last tick, referred to the robot's origin, in world axes."""
    robot_from_camera: Pose
    """Pose of the effective viewpoint or pinhole on the robot."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewRequest:
    """One camera to render, in one state."""

    camera: CameraSpec
    camera_state: CameraState
    label_channels: tuple[str, ...] = ()
    """Channels of labels that are wanted beside the image, in a frame of this view alone."""
    carrier: Carrier | None = None
    """Robot that carries the camera; None: a camera that stands."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameMetadata:
    """Robot and camera of a frame; empty for a frame of several robots or none."""

    robot: str = ""
    class_name: str = ""
    camera: str = ""
    """Name of the camera; empty for a frame of several cameras."""
    world_from_robot: Pose = field(default_factory=Pose.identity)
    robot_from_camera: Pose | None = None
    """Pose of the effective viewpoint or pinhole; None without a single camera."""
    camera_model: Pairs | None = None
    """Key-value pairs of the camera model, enough to compute the direction of every pixel; None
    without a single camera."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameComposition:
    """Views of a frame, tile by tile."""

    layout: TileLayout
    views: tuple[ViewRequest | None, ...]
    """None: a tile that stays black."""
    metadata: FrameMetadata = field(default_factory=FrameMetadata)
    min_interval_s: float = 0.0
    """Shortest simulation time to the next exposure of the same channel."""
    reference: ViewRequest | None = None
    """View to compare a single view with; None for no comparison."""
    is_turned: bool = False
    """Whether the pictures are turned round left to right."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameRequest:
    """A composition captured at one time."""

    channel: Channel
    sequence: int
    """Number of the frame within the channel, from 1."""
    time_s: float
    """Simulation time of the exposure."""
    exposed_at_s: float
    """Time of the exposure on the server's monotonic clock."""
    composition: FrameComposition
    repeats: int | None = None
    """Number of an earlier frame of the channel that shows the same; None: none does."""


@dataclass(frozen=True, slots=True)
class FrameRequested:
    """A connection waits for a frame of a channel."""

    newer_than: float = math.inf
    """Sequence number of the newest frame already at hand; a frame captured after that number and
    still being rendered satisfies the request, infinity always has a new one captured."""
    channel: Channel = IMAGE_PORT


@dataclass(frozen=True, slots=True)
class FrameRendered:
    """A requested frame is finished: the channel may capture the next one."""

    channel: Channel


# The events of `Mailboxes`, a part of the simulation's.
FrameEvent = FrameRequested | FrameRendered
_Encoding = ImageType | ImageEncoding


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A rendered image of a channel, and the measurements of its rendering."""

    sequence: int
    """Number of the frame within the channel, from 1."""
    time_s: float
    """Simulation time of the exposure."""
    rgb: Image
    """(h, w, 3) uint8, read-only."""
    exposed_at_s: float
    """Time of the exposure on the server's monotonic clock."""
    finished_at_s: float
    """End of the rendering on the server's monotonic clock."""
    channel: Channel = IMAGE_PORT
    metadata: FrameMetadata = field(default_factory=FrameMetadata)
    stage_ms: dict[str, float] = field(default_factory=dict)
    """Duration of each rendering stage, summed over all views."""
    render_duration_s: float = 0.0
    plan: str | None = None
    """Plans of all views in words; None for a black frame."""
    error_bound_px: float | None = None
    """Upper bound on the displacement of any outline; None where unknown."""
    error_bounds: dict[str, float] | None = None
    """All error bounds and their parts by name; None where unknown."""
    effect_decisions: tuple[EffectDecision, ...] = ()
    """Decisions about the effects of the camera, in a frame of one camera."""
    choice: PlanChoice | None = None
    """Choice of the plan, in a frame of one omnidirectional camera."""
    difference: ImageDifference | None = None
    """Set where the right half of the image shows a difference from a reference."""
    labels: FrameLabels | None = None
    """Labels of the picture, where the channel has any."""
    # A frozen frame with caches; encodings follow from the image alone.
    header: dict[str, Any] = field(default_factory=dict)
    """Plain fields of the stream's header that all clients have in common, once one was sent."""
    _encoded: dict[_Encoding, Payload] = field(default_factory=dict)
    _running: dict[_Encoding, asyncio.Task[Payload]] = field(default_factory=dict)

    async def encode(self, encoding: _Encoding) -> Payload:
        """Image as by `encode_without_blocking`, once for all clients; on the event loop."""
        # The stream's JPEG has the quality of type GOOD: both transports share one payload.
        if encoding is ImageEncoding.JPEG:
            return payload_of_reply(await self.encode(ImageType.GOOD))
        encoded = self._encoded.get(encoding)
        if encoded is None:
            encoded = self._encoded[encoding] = await self._encode_once(encoding)
        return encoded

    async def _encode_once(self, encoding: _Encoding) -> Payload:
        if is_quick(self.rgb, encoding):
            # Ends without a pause: the next client finds the payload.
            return await encode_without_blocking(self.rgb, encoding)
        if encoding not in self._running:
            encode = encode_without_blocking(self.rgb, encoding)
            self._running[encoding] = asyncio.create_task(encode)
        # Shielded: several connections wait for one thread, and any of them may disconnect.
        return await asyncio.shield(self._running[encoding])


# Level 1: ranges shrink to 60 % and ids to 1 % of their bytes; higher levels take twice the time
# for a few per cent.
_ZLIB_LEVEL = 1


@dataclass(frozen=True, slots=True, eq=False)
class FrameLabels:
    """Labels of the picture of one camera."""

    truth: GroundTruth
    has_row_times: bool = False
    """Whether each row of pixels has a time of its own."""
    is_displaced: bool = False
    """Whether the capture camera is displaced."""
    flow_to_time_s: float | None = None
    """Time of the frame that the flow leads to."""
    # A frozen record with a cache: payloads follow from the channels alone.
    _encoded: dict[ChannelEncoding, Mapping[str, Payload]] = field(default_factory=dict)

    def turn(self) -> FrameLabels:
        """Labels of the picture turned round left to right."""
        turned = {
            name: np.ascontiguousarray(values[:, ::-1])
            for name, values in self.truth.channels.items()
        }
        if "flow" in turned:
            turned["flow"][..., 0] *= -1.0
        return replace(self, truth=replace(self.truth, channels=turned), _encoded={})

    def objects_in_view(self) -> tuple[LabelledObject, ...]:
        """Objects whose numbers the channel `ids` has; none without that channel."""
        ids = self.truth.channels.get("ids")
        if ids is None:
            return ()
        present = np.bincount(ids.reshape(-1), minlength=2**16) > 0
        return tuple(one for one in self.truth.objects if present[one.number])

    async def encode(self, encoding: ChannelEncoding) -> Mapping[str, Payload]:
        """Parts of all channels by name, encoded once for all clients; on the event loop."""
        if encoding not in self._encoded:
            channels = self.truth.channels
            self._encoded[encoding] = (
                {name: values.data.cast("B") for name, values in channels.items()}
                if encoding is ChannelEncoding.RAW
                else await asyncio.to_thread(_compress, channels)
            )
        return self._encoded[encoding]


@dataclass(frozen=True, slots=True)
class ImageDifference:
    """Difference in encoded grey levels."""

    reference_plan: str
    """Plan of the reference in words."""
    max_levels: int
    """Largest absolute difference of a value."""
    rms_levels: float
    """Root mean square over all pixels and colours."""
    changed_fraction: float
    """Fraction of the pixels that differ in a colour."""


def append_difference(
    rgb: Image, reference: Image, reference_plan: str
) -> tuple[Image, ImageDifference]:
    """Image of twice the width, with the absolute differences to the right of the picture.

    Args:
        rgb: (h, w, 3) uint8.
        reference: Likewise, of the same exposure.
        reference_plan: Plan of the reference in words.

    Returns:
        The (h, 2 w, 3) image, read-only, and the difference in numbers.
    """
    # In uint8: the larger minus the smaller never wraps around.
    levels = np.maximum(rgb, reference) - np.minimum(rgb, reference)
    image = np.concatenate((rgb, levels), axis=1)
    image.setflags(write=False)
    squares = np.bincount(levels.ravel(), minlength=256) * np.arange(256.0) ** 2
    return image, ImageDifference(
        reference_plan,
        max_levels=int(levels.max(initial=0)),
        rms_levels=math.sqrt(float(squares.sum()) / max(1, levels.size)),
        changed_fraction=float(levels.any(axis=2).mean()),
    )


def _compress(channels: Channels) -> Mapping[str, Payload]:
    return {
        name: zlib.compress(values.data.cast("B"), _ZLIB_LEVEL) for name, values in channels.items()
    }
