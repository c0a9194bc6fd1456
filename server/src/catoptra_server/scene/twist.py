"""How things move while a picture is exposed: velocities, and what a viewpoint sees of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose

Vector3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Twist:
    """A rigid motion: m/s of what is at the frame's origin, and rad/s about axes through it.

    The origin and the axes are those of the frame that whoever holds it names.
    """

    linear_m_s: Vector3 = (0.0, 0.0, 0.0)
    angular_rad_s: Vector3 = (0.0, 0.0, 0.0)

    def at_offset(self, offset_m: Floats) -> Twist:
        """Return the same motion, told at another origin: (3,) metres from this one."""
        linear = np.asarray(self.linear_m_s) + np.cross(self.angular_rad_s, offset_m)
        return Twist(_vector3(linear), self.angular_rad_s)

    def relative_to(self, other: Twist) -> Twist:
        """Return the motion as seen from what moves otherwise, both told at one origin."""
        linear = np.subtract(self.linear_m_s, other.linear_m_s)
        return Twist(
            _vector3(linear), _vector3(np.subtract(self.angular_rad_s, other.angular_rad_s))
        )

    def rotate(self, rotation: Floats) -> Twist:
        """Return the same motion in axes that a (3, 3) rotation leads to."""
        linear = rotation @ np.asarray(self.linear_m_s)
        return Twist(_vector3(linear), _vector3(rotation @ np.asarray(self.angular_rad_s)))

    def integrate_pose(self, pose: Pose, time_s: float) -> Pose:
        """Return where a pose that moves so, told in its parent's axes, is after some seconds."""
        if self == AT_REST:
            return pose
        turn = _rotation_from_vector(np.asarray(self.angular_rad_s) * time_s)
        way = np.asarray(self.linear_m_s) * time_s
        return Pose(turn @ pose.rotation, pose.translation + way)

    @property
    def speed_m_s(self) -> float:
        """Return how fast the origin moves."""
        return float(np.linalg.norm(self.linear_m_s))


AT_REST = Twist()


def _vector3(values: Floats) -> Vector3:
    x, y, z = values.tolist()
    return x, y, z


def _rotation_from_vector(vector: Floats) -> Floats:
    """Return the (3, 3) rotation about a vector by its length in radians: Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    across = np.cross(np.eye(3), vector / angle)
    turn: Floats = np.eye(3) + np.sin(angle) * across + (1.0 - np.cos(angle)) * across @ across
    return turn
