"""What a client of the modern stream may ask: one frozen dataclass a request.

Every field is always there, nil where there is nothing. `id` is the client's own choice, above 0;
the answer carries it back. To add one: its dataclass, its line in the union and in REQUESTS, its
row in SPEC.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import ClassVar

from catoptra_protocol.wire.numbers import Vector


class Encoding(Enum):
    """What the picture's part is: rows of R, G, B bytes without padding, or a file of this kind."""

    RAW = "raw"
    JPEG = "jpeg"
    PNG = "png"


@dataclass(frozen=True, slots=True)
class AskFrame:
    """Ask for the newest frame not sent yet; an empty name takes the camera that is shown."""

    KIND: ClassVar[str] = "ask_frame"

    id: int
    robot: str
    camera: str
    encoding: Encoding


@dataclass(frozen=True, slots=True)
class AskSpawn:
    """Ask for a robot, at a location or at a named start; location goes before start."""

    KIND: ClassVar[str] = "ask_spawn"

    id: int
    class_name: str
    name: str | None
    location_m: Vector | None
    rotation_rad: Vector
    start: str | None


@dataclass(frozen=True, slots=True)
class AskDrive:
    """Set wheel speeds in rad/s, or in percent if normalized; None leaves a side as it is."""

    KIND: ClassVar[str] = "ask_drive"

    id: int
    left: float | None
    right: float | None
    normalized: bool


@dataclass(frozen=True, slots=True)
class AskStep:
    """Advance a lockstep clock."""

    KIND: ClassVar[str] = "ask_step"

    id: int
    time_s: float


@dataclass(frozen=True, slots=True)
class AskReset:
    """Take this client's robot out of the world, so that it can be spawned anew."""

    KIND: ClassVar[str] = "ask_reset"

    id: int


@dataclass(frozen=True, slots=True)
class AskReadings:
    """Ask for the newest reading of each of the robot's sensors."""

    KIND: ClassVar[str] = "ask_readings"

    id: int


@dataclass(frozen=True, slots=True)
class AskCamera:
    """Ask for the law of a camera; an empty name takes the first."""

    KIND: ClassVar[str] = "ask_camera"

    id: int
    camera: str


@dataclass(frozen=True, slots=True)
class AskLandmarks:
    """Ask where the world's landmarks truly are; with a robot or camera, what that camera sees.

    robot, camera: as in AskFrame; both None: what is seen is not asked.
    """

    KIND: ClassVar[str] = "ask_landmarks"

    id: int
    robot: str | None = None
    camera: str | None = None


@dataclass(frozen=True, slots=True)
class AskStarts:
    """Ask for the named start poses."""

    KIND: ClassVar[str] = "ask_starts"

    id: int


@dataclass(frozen=True, slots=True)
class AskStatus:
    """Ask what this server is and what it is doing."""

    KIND: ClassVar[str] = "ask_status"

    id: int


@dataclass(frozen=True, slots=True)
class AskPlan:
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
    AskFrame | AskSpawn | AskDrive | AskStep | AskReset
    | AskReadings | AskCamera | AskLandmarks | AskStarts | AskStatus | AskPlan
)  # fmt: skip
REQUESTS: dict[str, type[Request]] = {
    form.KIND: form
    for form in (
        *(AskFrame, AskSpawn, AskDrive, AskStep, AskReset),
        *(AskReadings, AskCamera, AskLandmarks, AskStarts, AskStatus, AskPlan),
    )
}
