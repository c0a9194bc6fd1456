"""Mission packages: chains of joints that carry a camera, such as a pan-tilt head.

A joint frame's z is the joint's axis, as GEO lists it; at rest what a link carries is aligned with
the chassis all the same, as in USARSim, whose parts have frames of their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.robot.mount import Vector3

# Orders of a joint command; the two relative ones add to what is.
ANGLE, SPEED, BRAKE, RELATIVE_ANGLE, RELATIVE_SPEED = 0, 1, 3, 10, 11
# The chassis among parents.
CHASSIS_PARENT = -1


@dataclass(frozen=True, slots=True)
class LinkDescription:
    """A link and the revolute joint that moves it against its parent (-1 = chassis, else 1, ...).

    Range without limits where the minimum is the greater one, as USARSim writes it.
    """

    name: str
    parent: int
    position_m: Vector3
    rotation_rad: Vector3
    max_speed_rad_s: float
    max_torque: float
    min_rad: float = 1.0
    max_rad: float = 0.0

    def clamp(self, angle_rad: float) -> float:
        """Return the angle within the joint's range."""
        if self.min_rad > self.max_rad:
            return angle_rad
        return min(max(angle_rad, self.min_rad), self.max_rad)


@dataclass(frozen=True, slots=True)
class MissionPackageDescription:
    """A named chain of links, numbered from 1."""

    name: str
    links: tuple[LinkDescription, ...]

    def robot_from_link(self, number: int, joint_angles_rad: Mapping[str, float]) -> Pose:
        """Return where what a link carries is; `joints` are radians by lower-case link name."""
        at_rest = self._robot_from_joint(number, {})
        aligned = Pose(at_rest.rotation.T.copy(), Pose.identity().translation)
        return self._robot_from_joint(number, joint_angles_rad) @ aligned

    def _robot_from_joint(self, number: int, joint_angles_rad: Mapping[str, float]) -> Pose:
        link = self.links[number - 1]
        placed = Pose.from_rpy(link.position_m, link.rotation_rad)
        turned = Pose.from_rpy(
            (0.0, 0.0, 0.0), (0.0, 0.0, joint_angles_rad.get(link.name.lower(), 0.0))
        )
        if link.parent == CHASSIS_PARENT:
            return placed @ turned
        return self._robot_from_joint(link.parent, joint_angles_rad) @ placed @ turned


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint in motion: its angle, and where it goes. `target_rad` inf = on and on."""

    link: LinkDescription
    angle_rad: float = 0.0
    target_rad: float = 0.0
    speed_rad_s: float = 0.0

    @property
    def velocity_rad_s(self) -> float:
        """Return its signed speed; 0 once it has arrived."""
        way = self.target_rad - self.angle_rad
        return math.copysign(self.speed_rad_s, way) if way else 0.0

    @property
    def torque(self) -> float:
        """Return what it pulls with: all it has while it moves."""
        velocity = self.velocity_rad_s
        return math.copysign(self.link.max_torque, velocity) if velocity else 0.0

    def apply_command(self, value: float, order: int) -> Joint:
        """Return the joint under a command: an angle to reach, or a speed to keep.

        Torques are not simulated: they leave the joint as it is.
        """
        if order == ANGLE:
            return self._move_to(value)
        if order == RELATIVE_ANGLE:
            return self._move_to(self.angle_rad + value)
        if order == SPEED:
            return self._run_at(value)
        if order == RELATIVE_SPEED:
            return self._run_at(self.velocity_rad_s + value)
        return self._run_at(0.0) if order == BRAKE else self

    def _move_to(self, angle_rad: float) -> Joint:
        fastest = self.link.max_speed_rad_s
        return replace(self, target_rad=self.link.clamp(angle_rad), speed_rad_s=fastest)

    def _run_at(self, speed_rad_s: float) -> Joint:
        if not speed_rad_s:
            return replace(self, target_rad=self.angle_rad, speed_rad_s=0.0)
        end = self.link.clamp(math.copysign(math.inf, speed_rad_s))
        speed = min(abs(speed_rad_s), self.link.max_speed_rad_s)
        return replace(self, target_rad=end, speed_rad_s=speed)

    def step(self, duration_s: float) -> Joint:
        """Return the joint after a time."""
        way = self.velocity_rad_s * duration_s
        arrives = abs(self.target_rad - self.angle_rad) <= abs(way)
        return replace(self, angle_rad=self.target_rad if arrives else self.angle_rad + way)


def _pan_tilt(name: str) -> MissionPackageDescription:
    """Return the pan-tilt head of UT2004's robots. Source: GEO and CONF of real ones."""
    pan = LinkDescription("CameraPan", CHASSIS_PARENT, (0.1239, 0.0, -0.2036),
                          (math.pi, 0.0, 0.0), 0.17, 20.0)  # fmt: skip
    tilt = LinkDescription("CameraTilt", 1, (0.0, 0.0, 0.0599),
                           (0.5 * math.pi, 0.0, 0.0), 0.17, 20.0)  # fmt: skip
    return MissionPackageDescription(name, (pan, tilt))


# What a file may mount without a section of its own, by class name in lower case.
STANDARD_PACKAGES = {"camerapantilt": _pan_tilt("CameraPanTilt")}
