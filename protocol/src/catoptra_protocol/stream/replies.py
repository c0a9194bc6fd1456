"""The replies of a stream server: one frozen dataclass each, and their table REPLIES.

Three groups: the header of a frame, whose image and labels follow as further parts; replies about
the world; replies about the server and a robot. Every field is always present on the wire, nil
where there is no value.

To add a reply: its dataclass, its entry in `Reply`, its row in SPEC.md 9.3, a vector
in tests/conformance/data/stream, a sample in tests/helpers/stream_messages.py. A new field gets a
default where peers of an earlier release do not send it.
"""

from __future__ import annotations

from typing import ClassVar, get_args

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.requests import ImageEncoding, LabelsRecord, Transform
from catoptra_protocol.vectors import Vector3


@dataclass(frozen=True, slots=True)
class EffectRecord:
    """Decision about one image effect in a frame."""

    name: str
    enabled: bool
    bound: float
    """Largest change of any pixel that the effect can cause, encoded grey levels of 255."""
    threshold: float
    """Change up to which `auto` disables the effect, grey levels."""
    reason: str
    duration_ms: float | None = None
    """Duration in this frame; None for a disabled effect and for one that changes the scene, whose
    duration is part of the stages that render the scene."""
    basis: str = "proved"
    """What decided: `proved`, the bound alone; `measured`, the frame's own pixels."""
    change: float | None = None
    """Largest change of any pixel of this frame, grey levels, where measured."""
    displacement_px: float | None = None
    """Largest displacement of light; None for an effect that displaces none."""
    share_threshold: float = 1.0
    """Share of the pixels, changed by more than half a level, up to which `auto` disables it."""
    visible_share: float = 1.0
    """Upper bound of that share in this frame."""


@dataclass(frozen=True, slots=True)
class PlanAlternative:
    """A neighbour of the current plan on the Pareto front of error bound and cost."""

    plan: str
    error_bound_px: float
    cost_ms: float


@dataclass(frozen=True, slots=True)
class DifferenceRecord:
    """Difference of a picture from a reference, the right half of the image that shows both."""

    reference_plan: str
    """Description of the reference's rendering plan."""
    max_levels: int
    """Largest absolute difference of an encoded value."""
    rms_levels: float
    """Root mean square over all pixels and colours."""
    changed_fraction: float
    """Fraction of the pixels that differ in a colour."""


@dataclass(frozen=True, slots=True)
class FrameHeader:
    """Metadata of the image in the next part."""

    KIND: ClassVar[str] = "frame"

    version: int
    id: int
    robot: str
    """Robot with the camera; empty where several robots, or none, share the image."""
    class_name: str
    camera: str
    """Camera; empty where several cameras share the image."""
    sequence: int
    """Number of the frame on its channel, from 1."""
    time_s: float
    """Simulation time of the exposure."""
    world_from_robot: Transform
    """Pose of the robot at the exposure."""
    robot_from_mirror: Transform | None
    """Pose of the effective viewpoint (pinhole of an ordinary camera); None without one camera."""
    camera_model: dict[str, str] | None
    """Pairs of CONF; None without one camera."""
    plan: str | None
    """Description of the rendering plan; None if unknown."""
    error_bound_px: float | None
    """Bound on the displacement of any outline; None if unknown."""
    stage_ms: dict[str, float]
    """Duration of each rendering stage by name."""
    encoding: ImageEncoding
    width_px: int
    height_px: int
    age_s: float
    """Time from the exposure to the sending."""
    missed_frames: int
    """Frames of the channel rendered and not sent to this client, in total."""
    dropped_frames: int
    """Frames requested by this client that it did not read, in total."""
    # Defaults from here on: servers of an earlier release do not send these fields.
    error_bounds: dict[str, float] | None = None
    """`error_bound_px` and its parts by name (SPEC.md 9.5)."""
    effects: tuple[EffectRecord, ...] = ()
    """Decisions about the effects that the robot file names, in optical order."""
    predicted_ms: float | None = None
    """Predicted duration of a frame; None without an accuracy target."""
    target_met: bool = True
    """Whether the plan meets the accuracy target."""
    more_accurate: PlanAlternative | None = None
    """Next more accurate plan; None without an accuracy target."""
    faster: PlanAlternative | None = None
    """Next cheaper plan, likewise."""
    difference: DifferenceRecord | None = None
    """Set where the request names a reference: the image is twice as wide as the picture."""
    labels: LabelsRecord | None = None
    """Set where the request names channels, which follow the image in parts of their own."""

    def __str__(self) -> str:
        # Without the pairs of the camera model, which would fill the log of every frame.
        return (
            f"frame {self.sequence} of {self.camera!r}, {self.width_px} x {self.height_px} px "
            f"{self.encoding.value}, {1000.0 * self.age_s:.1f} ms old"
        )


@dataclass(frozen=True, slots=True)
class LandmarkRecord:
    """One landmark with the fields and units of `catoptra_protocol.landmarks.Landmark`."""

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
    # Not columns of the landmark file, so this is not a Landmark.
    pixel: tuple[float, float] | None = None
    """Projection of the band centre into the requested camera; None outside the image."""
    visible: bool | None = None
    """Whether the pixel lies in the image without an occluder; None without a camera."""


@dataclass(frozen=True, slots=True)
class LandmarksReply:
    """All landmarks of the world, in the world frame."""

    KIND: ClassVar[str] = "landmarks"

    id: int
    landmarks: tuple[LandmarkRecord, ...]
    time_s: float | None = None
    """Simulation time of the projections; None without a camera."""


@dataclass(frozen=True, slots=True)
class StartPoseRecord:
    """One named start pose in the world frame."""

    name: str
    location_m: Vector3
    rotation_rad: Vector3
    """Roll, pitch, yaw."""


@dataclass(frozen=True, slots=True)
class StartPosesReply:
    """All named start poses."""

    KIND: ClassVar[str] = "start_poses"

    id: int
    start_poses: tuple[StartPoseRecord, ...]


@dataclass(frozen=True, slots=True)
class RobotState:
    """One robot in the world frame."""

    name: str
    class_name: str
    world_from_robot: Transform
    """True pose of the chassis frame."""
    world_from_start: Transform
    """Pose at which the robot was spawned, to which odometry is relative."""
    wheel_speeds_rad_s: tuple[float, float]
    """Commanded speeds of the left and the right wheels."""
    shares_control: bool
    """Whether other clients may drive it."""
    # Defaults: servers of an earlier release do not send these.
    wheel_radius_m: float = 0.0
    wheel_separation_m: float = 0.0
    """Of GETGEO, by which a speed and a turn become speeds of wheels; 0: unknown."""


@dataclass(frozen=True, slots=True)
class NoteRecord:
    """Newest note of one name."""

    name: str
    time_s: float
    """Simulation time of its arrival."""
    text: str
    """A JSON object."""


@dataclass(frozen=True, slots=True)
class CommandRecord:
    """A command that a robot executed."""

    number: int
    """From 1 on; what is missing in between is no longer known."""
    time_s: float
    """Simulation time, between two ticks."""
    line: str
    """As on the control port, without line end; numbers are exact."""


@dataclass(frozen=True, slots=True)
class TickRecord:
    """A robot after a tick."""

    time_s: float
    """Simulation time."""
    world_from_robot: Transform
    """True pose."""
    wheel_speeds_rad_s: tuple[float, float]
    """As commanded, left and right."""
    reports: tuple[str, ...]
    """Readings of this tick, as in SensorReports."""


@dataclass(frozen=True, slots=True)
class StateReply:
    """All robots, and the newest readings and notes of one of them."""

    KIND: ClassVar[str] = "state"

    id: int
    time_s: float
    """Simulation time."""
    robots: tuple[RobotState, ...]
    """In the order of spawning."""
    robot: str
    """Robot of readings and notes; empty if there is none of the requested name."""
    reports: tuple[str, ...]
    """Newest reading of each sensor, as in SensorReports."""
    notes: tuple[NoteRecord, ...]
    commands: tuple[CommandRecord, ...] = ()
    """Commands to the robot after the requested one, INIT first; at most 64 KiB of them."""
    ticks: tuple[TickRecord, ...] = ()
    """Ticks of the robot after the requested one, at most 64. A robot's ticks are kept from the
    first request for them on, 256 of them."""


@dataclass(frozen=True, slots=True)
class SetupReply:
    """What it takes to build the same simulation again."""

    KIND: ClassVar[str] = "setup"

    id: int
    files: dict[str, str]
    """Texts of configuration files by name without folders."""
    digests: dict[str, str]
    """SHA-256 of these and of files that are no texts, such as a mesh as a world."""
    options: dict[str, str]
    """Options of the server's command line by name; files in it by name. And `server`, `kernel`:
    release, and SHA-256 of the native kernel, empty where it is not installed."""


@dataclass(frozen=True, slots=True)
class PixelReply:
    """What a camera sees at a point of its image."""

    KIND: ClassVar[str] = "pixel"

    id: int
    time_s: float
    """Simulation time."""
    theta_rad: float | None
    """Incidence angle; None outside the camera model's domain, as all below."""
    azimuth_rad: float | None
    """Azimuth in the camera frame, x towards y."""
    range_m: float | None
    """Distance along the ray; None if it meets nothing."""
    object: str
    """Name of the world's item or of the other robot that the ray meets; empty for none."""
    bound_px: float | None
    """Bound on the displacement of outlines at this point; None without a bound."""


@dataclass(frozen=True, slots=True)
class Ok:
    """Acknowledgement of a request without a result."""

    KIND: ClassVar[str] = "ok"

    id: int


@dataclass(frozen=True, slots=True)
class Error:
    """Rejection of a request, with a reason for people."""

    KIND: ClassVar[str] = "error"

    id: int
    """Id of the request; 0 for a message without a readable id above 0."""
    reason: str


@dataclass(frozen=True, slots=True)
class SensorReports:
    """Sensor readings as lines of the control protocol, without line ends."""

    KIND: ClassVar[str] = "sensor_reports"

    id: int
    reports: tuple[str, ...]
    # A default: servers of an earlier release do not send this field.
    moved_to: Vector3 | None = None
    """Location of a spawned robot in the world frame, in metres, where the requested place was not
    free; otherwise None."""
    robot: str = ""
    """Name of a spawned robot; empty in other replies."""


@dataclass(frozen=True, slots=True)
class CameraReply:
    """Model, mounting and rendering plan of a camera."""

    KIND: ClassVar[str] = "camera"

    id: int
    class_name: str
    """Class of the robots with this camera."""
    camera: str
    camera_model: dict[str, str]
    """Pairs of CONF."""
    robot_from_mirror: Transform
    """Pose of the effective viewpoint."""
    plan: str | None
    """Description of the rendering plan; None before the first one."""


@dataclass(frozen=True, slots=True)
class StatusReply:
    """Identity and state of the server."""

    KIND: ClassVar[str] = "status"

    version: int
    """Version of the stream protocol."""
    id: int
    server: str
    """Product and release."""
    world: str
    class_names: tuple[str, ...]
    """Robot classes that can be spawned."""
    clock: str
    """`realtime` or `lockstep`."""
    num_clients: int
    has_robot: bool
    """Whether this client has a robot."""
    sent_frames: int
    """Frames sent to this client."""


@dataclass(frozen=True, slots=True)
class PlanReply:
    """The rendering plan of a camera, and its neighbours in either direction."""

    KIND: ClassVar[str] = "plan"

    id: int
    camera: str
    max_error_px: float
    """Tolerance; 0 = none."""
    budget_ms: float
    """Budget; 0 = none."""
    plan: str
    target_met: bool
    """Whether the plan meets the target; the reason is part of `plan`."""
    error_bound_px: float | None
    """Bound on the displacement of any outline; None without a bound."""
    error_bounds: dict[str, float] | None
    """`error_bound_px` and its parts by name (SPEC.md 9.5)."""
    cost_ms: float | None
    """Predicted duration of a frame; None without a target."""
    median_frame_ms: float | None
    """Median duration of the last 30 frames; None before."""
    more_accurate: PlanAlternative | None
    faster: PlanAlternative | None


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """Unsolicited sign of life, independent of simulation and rendering."""

    KIND: ClassVar[str] = "heartbeat"

    version: int


Reply = (
    FrameHeader
    | Ok
    | Error
    | SensorReports
    | CameraReply
    | LandmarksReply
    | StartPosesReply
    | StatusReply
    | PlanReply
    | StateReply
    | SetupReply
    | PixelReply
    | Heartbeat
)

REPLIES: dict[str, type[Reply]] = {reply.KIND: reply for reply in get_args(Reply)}
