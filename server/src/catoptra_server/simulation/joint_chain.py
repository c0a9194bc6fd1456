"""Mission packages: chains of revolute joints that carry a camera, such as a pan-tilt head.

The z axis of a joint frame is the axis of the joint, as GEO lists joints. At rest an item on a link
is nevertheless aligned with the chassis, as in USARSim, whose parts have frames of their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.vectors import Vector3

# Orders of a joint command on the wire; the two relative ones add to the present value.
ANGLE, SPEED, BRAKE, RELATIVE_ANGLE, RELATIVE_SPEED = 0, 1, 3, 10, 11
# Number of the chassis among parents.
CHASSIS_PARENT = -1


@dataclass(frozen=True, slots=True)
class LinkDescription:
    """A link and the joint between parent and link."""

    name: str
    parent: int
    """Number of the parent link from 1; -1 for the chassis."""
    position_m: Vector3
    rotation_rad: Vector3
    """Roll, pitch, yaw of the joint frame in the parent's."""
    max_speed_rad_s: float
    max_torque: float
    # USARSim writes a joint without limits as a range whose minimum exceeds the maximum.
    min_rad: float = 1.0
    max_rad: float = 0.0

    def limit_angle(self, angle_rad: float) -> float:
        """Angle limited to the joint's range."""
        if self.min_rad > self.max_rad:
            return angle_rad
        return min(max(angle_rad, self.min_rad), self.max_rad)


@dataclass(frozen=True, slots=True)
class MissionPackageDescription:
    """A named chain of links."""

    name: str
    links: tuple[LinkDescription, ...]

    def robot_from_link(self, number: int, joint_angles_rad: Mapping[str, float]) -> Pose:
        """Pose of an item that a link carries.

        Args:
            number: Number of the link, from 1.
            joint_angles_rad: Angles by lower-case link name; a missing joint is at rest.
        """
        at_rest = self._robot_from_joint(number, {})
        aligned = Pose(at_rest.rotation.T.copy(), Pose.identity().translation)
        return self._robot_from_joint(number, joint_angles_rad) @ aligned

    def _robot_from_joint(self, number: int, joint_angles_rad: Mapping[str, float]) -> Pose:
        link = self.links[number - 1]
        parent_from_joint = Pose.from_rpy(link.position_m, link.rotation_rad)
        angle_rad = joint_angles_rad.get(link.name.lower(), 0.0)
        rotation = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, angle_rad))
        if link.parent == CHASSIS_PARENT:
            return parent_from_joint @ rotation
        robot_from_parent = self._robot_from_joint(link.parent, joint_angles_rad)
        return robot_from_parent @ parent_from_joint @ rotation


@dataclass(frozen=True, slots=True)
class Joint:
    """State of a joint."""

    link: LinkDescription
    angle_rad: float = 0.0
    target_rad: float = 0.0
    """Angle to move to; infinite for a joint that runs at a speed without limits."""
    speed_rad_s: float = 0.0

    @property
    def velocity_rad_s(self) -> float:
        """Signed speed; 0 at the target."""
        remaining_rad = self.target_rad - self.angle_rad
        return math.copysign(self.speed_rad_s, remaining_rad) if remaining_rad else 0.0

    @property
    def torque(self) -> float:
        """Signed torque: the maximum while the joint moves, as loads are not simulated."""
        velocity = self.velocity_rad_s
        return math.copysign(self.link.max_torque, velocity) if velocity else 0.0

    def apply_command(self, value: float, order: int) -> Joint:
        """Joint under a command: an angle to reach, or a speed to keep.

        Orders of torques are not simulated and leave the joint unchanged.
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
        speed_rad_s = self.link.max_speed_rad_s
        return replace(self, target_rad=self.link.limit_angle(angle_rad), speed_rad_s=speed_rad_s)

    def _run_at(self, speed_rad_s: float) -> Joint:
        if not speed_rad_s:
            return replace(self, target_rad=self.angle_rad, speed_rad_s=0.0)
        # A speed is a move to the end of the range, which is infinite for a joint without limits.
        end = self.link.limit_angle(math.copysign(math.inf, speed_rad_s))
        speed = min(abs(speed_rad_s), self.link.max_speed_rad_s)
        return replace(self, target_rad=end, speed_rad_s=speed)

    def step(self, duration_s: float) -> Joint:
        """Joint after a time."""
        change_rad = self.velocity_rad_s * duration_s
        # Set to the target, not stepped past it: a sum of steps would oscillate around the angle.
        arrives = abs(self.target_rad - self.angle_rad) <= abs(change_rad)
        return replace(self, angle_rad=self.target_rad if arrives else self.angle_rad + change_rad)


def _pan_tilt(name: str) -> MissionPackageDescription:
    """Pan-tilt head of UT2004's robots. Source: GEO and CONF replies of real servers."""
    pan = LinkDescription("CameraPan", CHASSIS_PARENT, (0.1239, 0.0, -0.2036),
                          (math.pi, 0.0, 0.0), 0.17, 20.0)  # fmt: skip
    tilt = LinkDescription("CameraTilt", 1, (0.0, 0.0, 0.0599),
                           (0.5 * math.pi, 0.0, 0.0), 0.17, 20.0)  # fmt: skip
    return MissionPackageDescription(name, (pan, tilt))


# Packages that a file may mount without a section for the class, by class name in lower case.
STANDARD_PACKAGES = {"camerapantilt": _pan_tilt("CameraPanTilt")}
