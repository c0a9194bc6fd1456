"""RES, the outcome of a command: the reply of UT2004 to SET; UDK has none.

Time has 2 decimals, as UnrealScript prints a float; that of our STEP has 4. INIT has a result where
the first reports of the robot would not say it: rejected, or put elsewhere. It is ours, in both
dialects; USARSim is silent.
"""

from __future__ import annotations

import re
from typing import ClassVar

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.grammar import Dialect, Message, Pairs, split_groups
from catoptra_protocol.usarsim.value_format import format_fixed_point, format_vector
from catoptra_protocol.vectors import Vector3

STATUS_OK = "OK"
STATUS_FAILED = "Failed"
# In place of a camera's name: an empty viewport by command, and one whose camera does not exist.
CAMERA_DISABLED = "Disabled"
CAMERA_MISSING = "None"

_STEP_TYPE, _INIT_TYPE = "Step", "Init"
_UNSENDABLE = re.compile(r"[^ -z|~\xa1-\xff]")
NUM_VIEWPORTS = 4


@dataclass(frozen=True, slots=True)
class CommandResult:
    """Outcome of a SET, or of our STEP, whose reply exists in the UDK dialect too."""

    WORD: ClassVar[str] = "RES"

    time_s: float
    type: str
    """Type of the part, or `Step`."""
    name: str
    """Name of the part; empty for a SET without a name."""
    status: str = STATUS_OK
    """STATUS_OK or STATUS_FAILED."""

    @classmethod
    def from_message(cls, message: Message) -> CommandResult:
        """Parse the message of a line."""
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            type=strict_fields.read_text(message, "Type"),
            name=message.get("Name") or "",
            status=strict_fields.read_text(message, "Status"),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line; none in UDK, except of STEP. Without a name there is no block for a name."""
        name_pairs = (("Name", self.name),) if self.name else ()
        # A client of lockstep has to know when a step has ended, in either dialect.
        is_step = self.type == _STEP_TYPE
        head = (("Time", format_fixed_point(self.time_s, 4 if is_step else 2)), ("Type", self.type))
        pairs = (*head, *name_pairs, ("Status", self.status))
        is_silent = dialect is Dialect.UDK and not is_step
        return () if is_silent else (Message(self.WORD, pairs),)


@dataclass(frozen=True, slots=True)
class InitResult:
    """Outcome of an INIT."""

    WORD: ClassVar[str] = "RES"

    time_s: float
    name: str = ""
    """Name of the robot; empty for a rejected INIT."""
    moved_to: Vector3 | None = None
    """Location of the robot in metres where the requested one was not free."""
    failure: str = ""
    """Reason of a rejection, with the names that exist; empty for a robot that was spawned."""

    @classmethod
    def from_message(cls, message: Message) -> InitResult:
        """Parse the message of a line."""
        is_moved = message.get("Location") is not None
        is_spawned = strict_fields.read_text(message, "Status") == STATUS_OK
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            name=message.get("Name") or "",
            moved_to=strict_fields.read_vector(message, "Location") if is_moved else None,
            failure="" if is_spawned else message.get("Reason") or "no reason is known",
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line, the same in both dialects; none where the first reports say all."""
        head = _time_and_type_pairs(self.time_s, _INIT_TYPE)
        if self.failure:
            # Names of files may have what no line can carry; the log has the reason as it is.
            reason = _UNSENDABLE.sub("?", self.failure)
            return (Message(self.WORD, (*head, ("Status", STATUS_FAILED), ("Reason", reason))),)
        if self.moved_to is None:
            return ()
        location = ("Location", format_vector(self.moved_to))
        name = ("Name", self.name)
        return (Message(self.WORD, (*head, name, ("Status", STATUS_OK), location)),)


@dataclass(frozen=True, slots=True)
class CameraFov:
    """Outcome of a SET for one camera."""

    name: str
    fov_rad: float
    """Field of view after the command."""
    status: str = STATUS_OK
    """STATUS_FAILED if the camera has another field of view than requested."""


@dataclass(frozen=True, slots=True)
class CameraResult:
    """Outcome of a SET Camera, for each camera of the command."""

    WORD: ClassVar[str] = "RES"

    time_s: float
    cameras: tuple[CameraFov, ...]

    @classmethod
    def from_message(cls, message: Message) -> CameraResult:
        """Parse the message of a line."""
        cameras = (_parse_camera_fov(group) for group in split_groups(message, "Name"))
        return cls(strict_fields.read_number(message, "Time"), tuple(cameras))

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line; none in UDK."""
        cameras = (pair for camera in self.cameras for pair in _camera_pairs(camera))
        pairs = (*_time_and_type_pairs(self.time_s, "Camera"), *cameras)
        return () if dialect is Dialect.UDK else (Message(self.WORD, pairs),)


@dataclass(frozen=True, slots=True)
class Viewport:
    """Content of a quarter of the image-port picture."""

    camera: str = CAMERA_DISABLED
    """Name of a camera, CAMERA_DISABLED or CAMERA_MISSING."""
    status: str = STATUS_OK


@dataclass(frozen=True, slots=True)
class ViewportsResult:
    """Outcome of a SET Viewports: of the arrangement, and of each of the four."""

    WORD: ClassVar[str] = "RES"

    time_s: float
    config: str
    """`SingleView` or `QuadView`."""
    viewports: tuple[Viewport, ...] = (Viewport(),) * NUM_VIEWPORTS
    status: str = STATUS_OK
    """Outcome of the arrangement."""

    @classmethod
    def from_message(cls, message: Message) -> ViewportsResult:
        """Parse a line; each status follows the block of its subject."""
        keys = [f"Viewport{i + 1}" for i in range(NUM_VIEWPORTS)]
        runs = (group for key in keys for group in split_groups(message, key)[:1])
        # Each run extends to the end of the line; the first Status in it follows its own viewport.
        viewports = (Viewport(run.pairs[0][1], run.get("Status") or STATUS_OK) for run in runs)
        return cls(
            time_s=strict_fields.read_number(message, "Time"),
            config=strict_fields.read_text(message, "Config"),
            viewports=tuple(viewports),
            status=strict_fields.read_text(message, "Status"),
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line; none in UDK."""
        pairs = [*_time_and_type_pairs(self.time_s, "Viewports"), ("Config", self.config)]
        pairs.append(("Status", self.status))
        for i, viewport in enumerate(self.viewports):
            pairs += [(f"Viewport{i + 1}", viewport.camera), ("Status", viewport.status)]
        return () if dialect is Dialect.UDK else (Message(self.WORD, tuple(pairs)),)


def result_from_message(
    message: Message,
) -> CommandResult | InitResult | CameraResult | ViewportsResult:
    """Parse a RES line in the form of its type; a plain result if the command failed as a whole."""
    if message.get("Config") is not None:
        return ViewportsResult.from_message(message)
    # By the fields: a SET Camera that failed as a whole has no FOV, and is a plain result.
    if message.get("FOV") is not None:
        return CameraResult.from_message(message)
    if (message.get("Type") or "").lower() == _INIT_TYPE.lower():
        return InitResult.from_message(message)
    return CommandResult.from_message(message)


def _time_and_type_pairs(time_s: float, type_: str) -> Pairs:
    return ("Time", format_fixed_point(time_s, 2)), ("Type", type_)


def _camera_pairs(camera: CameraFov) -> Pairs:
    fov = format_fixed_point(camera.fov_rad)
    return ("Name", camera.name), ("FOV", fov), ("Status", camera.status)


def _parse_camera_fov(group: Message) -> CameraFov:
    name, fov_rad = strict_fields.read_text(group, "Name"), strict_fields.read_number(group, "FOV")
    return CameraFov(name, fov_rad, strict_fields.read_text(group, "Status"))
