"""Rigid motion: linear and angular velocity, and poses after some time of constant motion."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass

Vector3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Twist:
    """Velocity of a rigid frame, referred to the frame's origin.

    The holder of a twist names the frame, and the axes of both vectors.
    """

    linear_m_s: Vector3 = (0.0, 0.0, 0.0)
    """Velocity of the origin."""
    angular_rad_s: Vector3 = (0.0, 0.0, 0.0)
    """Angular velocity about axes through the origin."""

    def at_offset(self, offset_m: Floats) -> Twist:
        """Same motion, referred to another origin, (3,) metres from this one."""
        # Plain floats: composed for every frame, in a tenth of the time of arrays of three.
        vx, vy, vz = self.linear_m_s
        wx, wy, wz = self.angular_rad_s
        x, y, z = offset_m.tolist()
        linear = (vx + (wy * z - wz * y), vy + (wz * x - wx * z), vz + (wx * y - wy * x))
        return Twist(linear, self.angular_rad_s)

    def relative_to(self, other: Twist) -> Twist:
        """Motion relative to another frame, both referred to one origin."""
        (vx, vy, vz), (ux, uy, uz) = self.linear_m_s, other.linear_m_s
        (ax, ay, az), (bx, by, bz) = self.angular_rad_s, other.angular_rad_s
        return Twist((vx - ux, vy - uy, vz - uz), (ax - bx, ay - by, az - bz))

    def rotate(self, rotation: Floats) -> Twist:
        """Same motion in rotated axes, by a (3, 3) rotation."""
        linear = rotation @ np.asarray(self.linear_m_s)
        return Twist(_vector3(linear), _vector3(rotation @ np.asarray(self.angular_rad_s)))

    def integrate_pose(self, pose: Pose, time_s: float) -> Pose:
        """Pose after some seconds of this motion; both in the axes of the pose's parent."""
        # The same object, bit for bit: a standing robot's frames are then the same bytes.
        if self == AT_REST:
            return pose
        # Rotation and translation separately rather than along a screw: the origin keeps its
        # velocity in the world, which is the meaning of a twist here.
        rotation = _rotation_from_vector(np.asarray(self.angular_rad_s) * time_s)
        displacement = np.asarray(self.linear_m_s) * time_s
        return Pose(rotation @ pose.rotation, pose.translation + displacement)

    @property
    def speed_m_s(self) -> float:
        """Speed of the origin."""
        return float(np.linalg.norm(self.linear_m_s))


AT_REST = Twist()


def _vector3(values: Floats) -> Vector3:
    x, y, z = values.tolist()
    return x, y, z


def _rotation_from_vector(vector: Floats) -> Floats:
    """(3, 3) rotation about a vector by the vector's length in radians: Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    skew = np.cross(np.eye(3), vector / angle)
    rotation: Floats = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
    return rotation
