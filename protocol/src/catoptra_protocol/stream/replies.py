"""The replies of a stream server: one frozen dataclass each, and their table REPLIES.

Every field is always present on the wire, nil where there is no value. The header of a frame is in
frame_header.py, replies about the world are in world_replies.py.

To add a reply: its dataclass, its entries in `Reply` and REPLIES, its row in SPEC.md 9.3, a vector
in tests/conformance/data/stream, a sample in tests/helpers/stream_messages.py. A new field gets a
default where peers of an earlier release do not send it.
"""

from __future__ import annotations

from typing import ClassVar

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.frame_header import FrameHeader, PlanAlternative
from catoptra_protocol.stream.transform import Transform
from catoptra_protocol.stream.world_replies import (
    LandmarksReply,
    PixelReply,
    StartPosesReply,
    StateReply,
)
from catoptra_protocol.vectors import Vector3


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
    | PixelReply
    | Heartbeat
)

REPLIES: dict[str, type[Reply]] = {
    reply.KIND: reply
    for reply in (
        FrameHeader,
        Ok,
        Error,
        SensorReports,
        CameraReply,
        LandmarksReply,
        StartPosesReply,
        StatusReply,
        PlanReply,
        StateReply,
        PixelReply,
        Heartbeat,
    )
}
