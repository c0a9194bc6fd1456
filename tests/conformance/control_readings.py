"""Poses, ranges and encoder ticks of a robot, from the lines of either dialect."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.usarsim.grammar import Message, items_from_message
from conformance.check import CheckFailed

Floats = npt.NDArray[np.float64]
Cycle = dict[str, list[Message]]
"""Newest reports by sensor type in lower case."""

POSE_SENSORS = ("groundtruth", "ins", "odometry")
_NUMBER = re.compile(r"-?\d+(\.\d+)?")
# Above any angle of a robot that has turned once: an unwrapped one (UDK) and its noise.
_MAX_ANGLE_RAD = 4.0 * math.pi


@dataclass(frozen=True, slots=True)
class PlanarMotion:
    """Motion of a robot in the frame of its pose before: x forward, y right, yaw clockwise."""

    x_m: float
    y_m: float
    yaw_rad: float

    @property
    def distance_m(self) -> float:
        """Distance between both places."""
        return math.hypot(self.x_m, self.y_m)


@dataclass(frozen=True, slots=True)
class PlanarPose:
    """Place and heading of a robot, in any level frame."""

    x_m: float
    y_m: float
    yaw_rad: float

    def motion_to(self, later: PlanarPose) -> PlanarMotion:
        """Motion from this pose to a later one; a turn of less than half a revolution."""
        dx, dy = later.x_m - self.x_m, later.y_m - self.y_m
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return PlanarMotion(
            cos * dx + sin * dy, cos * dy - sin * dx, wrap(later.yaw_rad - self.yaw_rad)
        )


def wrap(angle_rad: float) -> float:
    """Angle in [-pi, pi]."""
    return math.remainder(angle_rad, math.tau)


def read_numbers(message: Message, name: str, count: int) -> tuple[float, ...]:
    """Numbers of a field.

    Raises:
        CheckFailed: The field is missing, or is not this many plain decimals.
    """
    parts = (message.get(name) or "").split(",")
    if len(parts) != count or not all(map(_NUMBER.fullmatch, parts)):
        text = f"{count} plain decimals" if count > 1 else "one plain decimal"
        raise CheckFailed(f"{message}: {name} is {','.join(parts)!r}, expected {text}")
    return tuple(map(float, parts))


def read_number(message: Message, name: str) -> float:
    """Number of a field; raises as `read_numbers`."""
    return read_numbers(message, name, 1)[0]


def find_poses(cycle: Cycle) -> dict[str, PlanarPose]:
    """Poses of a cycle by sensor type.

    Raises:
        CheckFailed: An angle cannot be in radians.
    """
    poses = {type_: _read_pose(cycle[type_][0]) for type_ in POSE_SENSORS if type_ in cycle}
    for type_, pose in poses.items():
        if abs(pose.yaw_rad) > _MAX_ANGLE_RAD:
            raise CheckFailed(f"{cycle[type_][0]}: a heading of {pose.yaw_rad:g} is not in radians")
    return poses


def _read_pose(message: Message) -> PlanarPose:
    if message.get("Pose") is not None:
        return PlanarPose(*read_numbers(message, "Pose", 3))
    x, y, _ = read_numbers(message, "Location", 3)
    return PlanarPose(x, y, read_numbers(message, "Orientation", 3)[2])


def numbers_from_commas(text: str) -> list[float]:
    """Numbers of a list of any length.

    Raises:
        CheckFailed: A part is no plain decimal.
    """
    parts = text.split(",")
    for part in parts:
        if not _NUMBER.fullmatch(part):
            raise CheckFailed(f"{part[:40]!r} in a list of {len(parts)}: expected a plain decimal")
    return list(map(float, parts))


def find_ticks(cycle: Cycle) -> dict[str, float]:
    """Ticks of the encoders of a cycle by name in lower case."""
    return {name: read_number(item, "Tick") for name, item in _iter_items(cycle.get("encoder", ()))}


def find_sonar_ranges(cycle: Cycle) -> dict[str, float]:
    """Ranges of the sonars of a cycle by name in lower case."""
    return {name: read_number(item, "Range") for name, item in _iter_items(cycle.get("sonar", ()))}


def find_item_names(message: Message) -> list[str]:
    """Names of the sensors that a line lists."""
    return [name for name, _ in _iter_items([message])]


def _iter_items(messages: Iterable[Message]) -> Iterator[tuple[str, Message]]:
    """Iterate over name and fields of each sensor that lines list, in either dialect."""
    for message in messages:
        for item in items_from_message(message):
            yield (item.get("Name") or "").lower(), item
