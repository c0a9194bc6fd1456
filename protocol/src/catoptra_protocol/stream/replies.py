"""What a server of the modern stream says: one frozen dataclass an answer.

Every field is always there, nil where there is nothing. A frame's header is followed by a second
part, the picture. To add one: its dataclass, its line in the union and in ANSWERS, its row in
SPEC.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.stream.requests import ImageEncoding
from catoptra_protocol.usarsim.value_format import Vector3

RotationRows = tuple[float, float, float, float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Transform:
    """A rigid transform parent_from_child: the child's origin, and rotation (3, 3) row by row."""

    position_m: Vector3
    rotation: RotationRows


@dataclass(frozen=True, slots=True)
class EffectRecord:
    """What was decided about one effect: the most that it can change any pixel, and why.

    ms: what it took in this picture; None of one that is off, and of one that changes the scene:
    its time is in the stages that draw it.
    """

    name: str
    enabled: bool
    bound: float
    threshold: float
    unit: str
    reason: str
    duration_ms: float | None = None


@dataclass(frozen=True, slots=True)
class FrameHeader:
    """Everything that is known of the picture in the next part.

    error_bound_px: how far off any outline may be; bound: that and its parts by name.
    time_s, world_from_robot: of the exposure. camera_model: the pairs of CONF, None where no camera
    is shown. age_s: from the exposure to the sending. missed: frames drawn for others and not sent
    to this subscriber, in all. dropped: frames of its own that it did not take. error_bound_px and
    plan: None where unknown. effects: of those that the robot's file names, in optical order.
    """

    KIND: ClassVar[str] = "frame"

    version: int
    id: int
    robot: str
    class_name: str
    camera: str
    sequence: int
    time_s: float
    world_from_robot: Transform
    robot_from_mirror: Transform | None
    camera_model: dict[str, str] | None
    plan: str | None
    error_bound_px: float | None
    stage_ms: dict[str, float]
    encoding: ImageEncoding
    width_px: int
    height_px: int
    age_s: float
    missed_frames: int
    dropped_frames: int
    error_bounds: dict[str, float] | None = None
    effects: tuple[EffectRecord, ...] = ()

    def __str__(self) -> str:
        return (
            f"frame {self.sequence} of {self.camera!r}, {self.width_px} x {self.height_px} px "
            f"{self.encoding.value}, {1000.0 * self.age_s:.1f} ms old"
        )


@dataclass(frozen=True, slots=True)
class Ok:
    """It was done."""

    KIND: ClassVar[str] = "done"

    id: int


@dataclass(frozen=True, slots=True)
class Error:
    """It was not done, and why. id 0: what came could not be read so far."""

    KIND: ClassVar[str] = "refused"

    id: int
    reason: str


@dataclass(frozen=True, slots=True)
class SensorReports:
    """Lines of the control protocol: what the robot's sensors read."""

    KIND: ClassVar[str] = "reported"

    id: int
    reports: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class CameraReply:
    """A camera's law, as the pairs of CONF, where its viewpoint sits, and how it is drawn."""

    KIND: ClassVar[str] = "camera"

    id: int
    class_name: str
    camera: str
    camera_model: dict[str, str]
    robot_from_mirror: Transform
    plan: str | None


@dataclass(frozen=True, slots=True)
class LandmarkRecord:
    """One landmark, with the fields and units of the landmarks' file.

    Of the camera that was asked about, else None: pixel, where the middle of the band lies in its
    picture, None outside it. visible: whether it lies there and nothing stands before it.
    """

    name: str
    kind: str
    x_m: float
    y_m: float
    width_m: float
    depth_m: float
    band_bottom_m: float
    band_top_m: float
    lower_colour: str
    upper_colour: str
    pixel: tuple[float, float] | None = None
    visible: bool | None = None


@dataclass(frozen=True, slots=True)
class LandmarksReply:
    """All landmarks of the world, in the world frame. time_s: when a camera saw them so."""

    KIND: ClassVar[str] = "landmarks"

    id: int
    landmarks: tuple[LandmarkRecord, ...]
    time_s: float | None = None


@dataclass(frozen=True, slots=True)
class StartPoseRecord:
    """One named start pose."""

    name: str
    location_m: Vector3
    rotation_rad: Vector3


@dataclass(frozen=True, slots=True)
class StartPosesReply:
    """All named start poses."""

    KIND: ClassVar[str] = "starts"

    id: int
    start_poses: tuple[StartPoseRecord, ...]


@dataclass(frozen=True, slots=True)
class StatusReply:
    """What the server is: its world, the classes it can spawn, its clock; whom it serves."""

    KIND: ClassVar[str] = "status"

    version: int
    id: int
    server: str
    world: str
    class_names: tuple[str, ...]
    clock: str
    num_clients: int
    has_robot: bool
    sent_frames: int


@dataclass(frozen=True, slots=True)
class PlanAlternative:
    """Another plan: how far off its outlines may be, and what a frame is expected to take."""

    plan: str
    error_bound_px: float
    cost_ms: float


@dataclass(frozen=True, slots=True)
class PlanReply:
    """How a camera is drawn from now on, and what a little more or less would cost.

    max_error_px, budget_ms: what is asked, 0 = not. keeps_word: whether that is kept. error_px and
    bound: None where there is no bound. cost_ms: expected, None where nothing is asked. median_ms:
    of the last frames, None before there are 30.
    """

    KIND: ClassVar[str] = "plan"

    id: int
    camera: str
    max_error_px: float
    budget_ms: float
    plan: str
    target_met: bool
    error_bound_px: float | None
    error_bounds: dict[str, float] | None
    cost_ms: float | None
    median_frame_ms: float | None
    more_accurate: PlanAlternative | None
    faster: PlanAlternative | None


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """The server lives; sent to every client it knows, whatever the drawing does."""

    KIND: ClassVar[str] = "pulse"

    version: int


Reply = (
    FrameHeader | Ok | Error | SensorReports | CameraReply | LandmarksReply
    | StartPosesReply | StatusReply | PlanReply | Heartbeat
)  # fmt: skip

REPLIES: dict[str, type[Reply]] = {
    form.KIND: form
    for form in (
        *(FrameHeader, Ok, Error, SensorReports, CameraReply),
        *(LandmarksReply, StartPosesReply, StatusReply, PlanReply, Heartbeat),
    )
}
