"""What a client of the modern stream may ask: one frozen dataclass a request.

Every field is always there, nil where there is nothing. `id` is the client's own choice, above 0;
the answer carries it back. To add one: its dataclass, its line in the union and in REQUESTS, its
row in SPEC.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

from catoptra_protocol.usarsim.value_format import Vector3


class ImageEncoding(Enum):
    """What the picture's part is: rows of R, G, B bytes without padding, or a file of this kind."""

    RAW = "raw"
    JPEG = "jpeg"
    PNG = "png"


@dataclass(frozen=True, slots=True)
class GetFrameRequest:
    """Ask for the newest frame not sent yet; an empty name takes the camera that is shown."""

    KIND: ClassVar[str] = "ask_frame"

    id: int
    robot: str
    camera: str
    encoding: ImageEncoding


@dataclass(frozen=True, slots=True)
class SpawnRequest:
    """Ask for a robot, at a location or at a named start; location goes before start."""

    KIND: ClassVar[str] = "ask_spawn"

    id: int
    class_name: str
    name: str | None
    location_m: Vector3 | None
    rotation_rad: Vector3
    start: str | None


@dataclass(frozen=True, slots=True)
class DriveRequest:
    """Set wheel speeds in rad/s, or in percent if normalized; None leaves a side as it is."""

    KIND: ClassVar[str] = "ask_drive"

    id: int
    left: float | None
    right: float | None
    normalized: bool


@dataclass(frozen=True, slots=True)
class StepRequest:
    """Advance a lockstep clock."""

    KIND: ClassVar[str] = "ask_step"

    id: int
    time_s: float


@dataclass(frozen=True, slots=True)
class ResetRequest:
    """Take this client's robot out of the world, so that it can be spawned anew."""

    KIND: ClassVar[str] = "ask_reset"

    id: int


@dataclass(frozen=True, slots=True)
class GetReadingsRequest:
    """Ask for the newest reading of each of the robot's sensors."""

    KIND: ClassVar[str] = "ask_readings"

    id: int


@dataclass(frozen=True, slots=True)
class GetCameraRequest:
    """Ask for the law of a camera; an empty name takes the first."""

    KIND: ClassVar[str] = "ask_camera"

    id: int
    camera: str


@dataclass(frozen=True, slots=True)
class GetLandmarksRequest:
    """Ask where the world's landmarks truly are; with a robot or camera, what that camera sees.

    robot, camera: as in GetFrameRequest; both None: what is seen is not asked.
    """

    KIND: ClassVar[str] = "ask_landmarks"

    id: int
    robot: str | None = None
    camera: str | None = None


@dataclass(frozen=True, slots=True)
class GetStartPosesRequest:
    """Ask for the named start poses."""

    KIND: ClassVar[str] = "ask_starts"

    id: int


@dataclass(frozen=True, slots=True)
class GetStatusRequest:
    """Ask what this server is and what it is doing."""

    KIND: ClassVar[str] = "ask_status"

    id: int


@dataclass(frozen=True, slots=True)
class SetAccuracyRequest:
    """Ask how this client's robot's omnidirectional camera is drawn; or have it drawn otherwise.

    An empty camera takes the robot's. max_error_px: how far off any outline may be. budget_ms: how
    long a frame may take. 0 = not asked any more, None = as it is.
    """

    KIND: ClassVar[str] = "ask_plan"

    id: int
    camera: str
    max_error_px: float | None
    budget_ms: float | None


Request = (
    GetFrameRequest | SpawnRequest | DriveRequest | StepRequest | ResetRequest
    | GetReadingsRequest | GetCameraRequest | GetLandmarksRequest | GetStartPosesRequest | GetStatusRequest | SetAccuracyRequest
)  # fmt: skip
REQUESTS: dict[str, type[Request]] = {
    form.KIND: form
    for form in (
        *(GetFrameRequest, SpawnRequest, DriveRequest, StepRequest, ResetRequest),
        *(
            GetReadingsRequest,
            GetCameraRequest,
            GetLandmarksRequest,
            GetStartPosesRequest,
            GetStatusRequest,
            SetAccuracyRequest,
        ),
    )
}
