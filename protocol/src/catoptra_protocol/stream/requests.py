"""The requests of a stream client: one frozen dataclass each, and their table REQUESTS.

The records that requests and replies share are here too: a rigid transform, and the channels and
objects of labels. Every field is always present on the wire, nil where there is no value. The
client chooses each `id`, above 0; the reply has the same id.

To add a request: its dataclass, its entry in `Request`, its row in SPEC.md 9.2, a
vector in tests/conformance/data/stream, a sample in tests/helpers/stream_messages.py; then its case
in serve/stream/peer.py (all clients) or serve/stream/session.py (one robot) of the server.
"""

from __future__ import annotations

from enum import Enum
from typing import ClassVar, get_args

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.vectors import Vector3

# Nine numbers rather than three rows: msgpack would spend a header on each row.
_RotationRows = tuple[float, float, float, float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Transform:
    """A rigid transform parent_from_child."""

    position_m: Vector3
    """Origin of the child frame in the parent frame."""
    # A matrix has no convention to agree on, unlike a quaternion or three angles.
    rotation: _RotationRows
    """Rotation matrix (3, 3), row by row."""


class ChannelEncoding(Enum):
    """Encoding of a channel's part: rows of little-endian values, or these compressed by zlib."""

    RAW = "raw"
    ZLIB = "zlib"


@dataclass(frozen=True, slots=True)
class ChannelRecord:
    """One channel; the records are in the order of the parts."""

    name: str
    dtype: str
    """Type of a value as NumPy writes it, such as `<f4`."""
    depth: int
    """Values of a pixel."""
    encoding: ChannelEncoding
    num_bytes: int
    """Length of the part."""


@dataclass(frozen=True, slots=True)
class ObjectRecord:
    """One object in view, with its box at the exposure."""

    number: int
    """Value of the channel `ids`."""
    name: str
    class_name: str
    class_number: int
    """Value of the channel `classes`."""
    world_from_box: Transform
    """Pose of the box's centre."""
    half_size_m: Vector3
    """Half lengths of the edges."""


@dataclass(frozen=True, slots=True)
class LabelsRecord:
    """Labels of a frame, of the exact camera model whatever the plan of the picture."""

    channels: tuple[ChannelRecord, ...]
    objects: tuple[ObjectRecord, ...] = ()
    """Objects in view by ascending number, with the channel `ids`; the first 1000 of them."""
    times: str = "middle"
    """`middle`: all pixels at the middle of the exposure, `time_s`; `rows`: each row of a rolling
    shutter at the middle of its own."""
    is_displaced: bool = False
    """Whether the labels are of a displaced capture camera, as the picture is (Misalignment)."""
    flow_to_time_s: float | None = None
    """Time of the frame that the flow leads to, the last one of this channel; None without."""


class ImageEncoding(Enum):
    """Encoding of the image part: rows of R, G, B bytes without padding, or a JPEG or PNG file."""

    # R, G, B here, B, G, R on the image port: the order there is that of USARSim's clients.
    RAW = "raw"
    JPEG = "jpeg"
    PNG = "png"


@dataclass(frozen=True, slots=True)
class FrameVariant:
    """Other settings for the frames of one request; those of the robot's camera stay as they are.

    None leaves a value as the camera has it. Polygons or samples without a target take the place of
    the camera's own target.
    """

    max_error_px: float | None = None
    """Tolerance on the displacement of outlines; 0 = no tolerance."""
    budget_ms: float | None = None
    """Duration of a frame; 0 = no budget."""
    polygons: int | None = None
    """Polygons of the mirror mesh, a square number; 0 = the exact camera model in every sample."""
    samples: int | None = None
    """Samples along a pixel's side."""
    renderer: str | None = None
    """`trace` or `raster`."""
    effects: dict[str, str] | None = None
    """Mode of each named effect: `auto`, `always` or `never`."""
    reference: str | None = None
    """`exact` or `camera`: the image shows, to the right of the picture, its difference from the
    same exposure by the exact model with 4 x 4 samples, or by the camera's own settings."""
    picture: str | None = None
    """`mirrored` or `flipped`: the hand of the image. The other hand is the same picture, turned
    round left to right; the header's camera model is that of the image."""
    world_from_robot: Transform | None = None
    """Pose of the robot in this image, to the bit; the robot itself stays where it is."""


@dataclass(frozen=True, slots=True)
class GetFrameRequest:
    """Request the newest frame that this client has not received.

    Two empty names select the image-port picture, otherwise an empty name selects the robot shown
    there or the first camera of the robot.
    """

    KIND: ClassVar[str] = "get_frame"

    id: int
    robot: str
    """Exact name of the robot, or empty."""
    camera: str
    """Name of the camera in any case, or empty."""
    encoding: ImageEncoding
    # A default, as for all fields that clients of an earlier release do not send.
    variant: FrameVariant | None = None
    """Other settings, of an omnidirectional camera that is requested by name; None for its own."""
    channels: tuple[str, ...] = ()
    """Channels of labels that follow the image, of one camera of any kind: names of SPEC.md 9.8."""
    channel_encoding: ChannelEncoding = ChannelEncoding.RAW


@dataclass(frozen=True, slots=True)
class SpawnRequest:
    """Spawn a robot at a location or at a named start pose; the location takes precedence."""

    KIND: ClassVar[str] = "spawn"

    id: int
    # The fields of INIT, so that both transports spawn by the same rules.
    class_name: str
    name: str | None
    """Requested name; the server appends a number to a name in use."""
    location_m: Vector3 | None
    """Position in the world frame."""
    start: str | None
    """Name of a start pose."""
    # Of no effect with a start pose, so that a request may leave it out.
    rotation_rad: Vector3 | None = None
    """Roll, pitch, yaw in the world frame; with a location only. None = 0, 0, 0."""


@dataclass(frozen=True, slots=True)
class DriveRequest:
    """Set the wheel speeds of both sides; None leaves a side unchanged."""

    KIND: ClassVar[str] = "drive"

    id: int
    left: float | None
    """Speed in rad/s, or in percent of the maximum if normalized."""
    right: float | None
    """As `left`."""
    normalized: bool
    robot: str = ""
    """Exact name of a robot whose owner shares its control; empty for the client's own."""
    halt_after_s: float | None = None
    """Time, s, after which the robot halts unless another request sets its speeds; None: 0.25 s
    where a page of the web port drives, else never."""


@dataclass(frozen=True, slots=True)
class StepRequest:
    """Advance a lockstep clock by 0 to 60 s."""

    KIND: ClassVar[str] = "step"

    id: int
    time_s: float


@dataclass(frozen=True, slots=True)
class ResetRequest:
    """Remove the client's robot from the world and release its name."""

    KIND: ClassVar[str] = "reset"

    id: int


@dataclass(frozen=True, slots=True)
class GetReadingsRequest:
    """Request the newest reading of each sensor of the robot."""

    KIND: ClassVar[str] = "get_readings"

    id: int


@dataclass(frozen=True, slots=True)
class GetCameraRequest:
    """Request the model of a camera of either kind.

    An empty name selects the first camera of the client's robot; without a robot, that of the first
    class with a camera.
    """

    KIND: ClassVar[str] = "get_camera"

    id: int
    camera: str


@dataclass(frozen=True, slots=True)
class GetPartsRequest:
    """Request wheels and sensors of a robot class: limits, ranges, and poses on the robot."""

    KIND: ClassVar[str] = "get_parts"

    id: int
    class_name: str
    """One of those of the status, or of a robot in the state."""


@dataclass(frozen=True, slots=True)
class GetLandmarksRequest:
    """Request the true landmarks of the world, or their projections into one camera.

    `robot` and `camera` select the camera as in GetFrameRequest; both None: no projections.
    """

    KIND: ClassVar[str] = "get_landmarks"

    id: int
    # Defaults, since clients of the first release do not send these two.
    robot: str | None = None
    camera: str | None = None


@dataclass(frozen=True, slots=True)
class GetStartPosesRequest:
    """Request the named start poses."""

    KIND: ClassVar[str] = "get_start_poses"

    id: int


@dataclass(frozen=True, slots=True)
class GetStatusRequest:
    """Request identity and state of the server."""

    KIND: ClassVar[str] = "get_status"

    id: int


@dataclass(frozen=True, slots=True)
class SetAccuracyRequest:
    """Set the accuracy target of an omnidirectional camera, and request the resulting plan.

    With both targets None the request only reads the plan.
    """

    KIND: ClassVar[str] = "set_accuracy"

    id: int
    camera: str
    """Name, or empty for the omnidirectional camera of this client's robot."""
    max_error_px: float | None
    """Tolerance on the displacement of outlines; 0 = no tolerance, None = unchanged."""
    budget_ms: float | None
    """Duration of a frame; 0 = no budget, None = unchanged."""


@dataclass(frozen=True, slots=True)
class GetStateRequest:
    """Request the poses of all robots, and the newest readings and notes of one."""

    KIND: ClassVar[str] = "get_state"

    id: int
    robot: str
    """Exact name of the robot; empty for the one that the image port displays."""
    commands_after: int | None = None
    """Number of the last command to the robot that the client knows, 0 before the first; None for
    no commands."""
    ticks_after: float | None = None
    """Simulation time of the last tick that the client knows; None for no ticks."""


@dataclass(frozen=True, slots=True)
class GetSetupRequest:
    """Request what it takes to build the same simulation again."""

    KIND: ClassVar[str] = "get_setup"

    id: int


@dataclass(frozen=True, slots=True)
class GetPixelRequest:
    """Request what a camera sees at a point of its image; the camera as in GetFrameRequest."""

    KIND: ClassVar[str] = "get_pixel"

    id: int
    robot: str
    camera: str
    u_px: float
    """Column; pixel centres are at +0.5."""
    v_px: float
    """Row, likewise."""


@dataclass(frozen=True, slots=True)
class PublishRequest:
    """Publish a note about the client's robot, such as the belief of its localization.

    A note replaces the one of the same name; SPEC.md 9.7 lists the keys that viewers draw.
    """

    KIND: ClassVar[str] = "publish"

    id: int
    name: str
    text: str
    """A JSON object of at most 8 KiB."""


@dataclass(frozen=True, slots=True)
class ShareControlRequest:
    """Let other clients drive the client's robot, or no longer."""

    KIND: ClassVar[str] = "share_control"

    id: int
    shared: bool


Request = (
    GetFrameRequest
    | SpawnRequest
    | DriveRequest
    | StepRequest
    | ResetRequest
    | GetReadingsRequest
    | GetCameraRequest
    | GetPartsRequest
    | GetLandmarksRequest
    | GetStartPosesRequest
    | GetStatusRequest
    | SetAccuracyRequest
    | GetStateRequest
    | GetSetupRequest
    | GetPixelRequest
    | PublishRequest
    | ShareControlRequest
)

REQUESTS: dict[str, type[Request]] = {request.KIND: request for request in get_args(Request)}
