"""Coordinate frames, and the rotations and poses between frames.

| frame    | origin              | axes                                            |
|----------|---------------------|-------------------------------------------------|
| world    | of the world file   | SAE: x, y level, z down; yaw clockwise from above |
| robot    | the robot's chassis | x forward, y right, z down                      |
| mirror   | effective viewpoint | +z towards the pinhole; x, y as the robot's     |
| lens     | entrance pupil      | x along the optical axis, y right, z down       |
| image    | top left corner     | u right, v down, pixel centres at +0.5          |

Transforms are called target_from_source. Rotations are listed roll, pitch, yaw (about x, y, z;
applied in that order about fixed axes), as on USARSim's wire.

USARSim's wire has the same frames, so no sign changes between wire and world. On an upright robot
the optical axis points straight down.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import arctan2, cos, hypot, matmul, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass


def rotation_from_rpy(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Floats:
    """Rotation (3, 3) parent_from_child: Rz(yaw) Ry(pitch) Rx(roll)."""
    cr, cp, cy = cos(roll_rad), cos(pitch_rad), cos(yaw_rad)
    sr, sp, sy = sin(roll_rad), sin(pitch_rad), sin(yaw_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Rigid transform parent_from_child."""

    rotation: Floats
    """Rotation (3, 3)."""
    translation: Floats
    """Translation (3,), in metres."""

    @classmethod
    def from_rpy(cls, position_m: npt.ArrayLike, rpy_rad: npt.ArrayLike = (0.0, 0.0, 0.0)) -> Pose:
        """Pose at a (3,) position with (3,) roll, pitch, yaw."""
        roll, pitch, yaw = np.asarray(rpy_rad, dtype=np.float64)
        rotation = rotation_from_rpy(float(roll), float(pitch), float(yaw))
        return cls(rotation, np.array(position_m, dtype=np.float64))

    @classmethod
    def identity(cls) -> Pose:
        """Pose without rotation or translation."""
        return cls(np.eye(3), np.zeros(3))

    def __post_init__(self) -> None:
        self.rotation.setflags(write=False)
        self.translation.setflags(write=False)

    def __matmul__(self, child_from_grandchild: Pose) -> Pose:
        """Compose: parent_from_child @ child_from_grandchild = parent_from_grandchild."""
        rotation = matmul(self.rotation, child_from_grandchild.rotation)
        return Pose(rotation, self.transform_points(child_from_grandchild.translation))

    def inverse(self) -> Pose:
        """Inverse transform, child_from_parent."""
        return Pose(self.rotation.T.copy(), matmul(-self.rotation.T, self.translation))

    def transform_points(self, points_in_child: Floats) -> Floats:
        """Points (..., 3) in the parent frame."""
        return matmul(points_in_child, self.rotation.T) + self.translation

    def rotate_directions(self, directions_in_child: Floats) -> Floats:
        """Directions (..., 3) in the parent frame; the translation does not apply."""
        return matmul(directions_in_child, self.rotation.T)

    @property
    def quaternion(self) -> Floats:
        """Unit quaternion (4,) of the rotation, in the order x, y, z, w of ROS and SciPy.

        Of the two quaternions of a rotation the one with w >= 0; of a half turn, where w is 0, the
        one whose first component that is not 0 is positive. Source: Shepperd 1978.
        """
        ((xx, xy, xz), (yx, yy, yz), (zx, zy, zz)) = self.rotation.tolist()
        # 4 q q^T: every entry is linear in the rotation, so each row is the quaternion, scaled.
        products = np.array(
            [
                [1 + xx - yy - zz, xy + yx, zx + xz, zy - yz],
                [xy + yx, 1 - xx + yy - zz, yz + zy, xz - zx],
                [zx + xz, yz + zy, 1 - xx - yy + zz, yx - xy],
                [zy - yz, xz - zx, yx - xy, 1 + xx + yy + zz],
            ]
        )
        # The row of the largest component, at least a half: the others cancel near half turns.
        largest = int(np.argmax(np.diagonal(products)))
        quaternion: Floats = products[largest] / hypot(*products[largest])
        leading = next(part for part in quaternion[[3, 0, 1, 2]] if part != 0.0)
        return quaternion if leading > 0.0 else -quaternion

    def to_rpy(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw of the rotation, in radians.

        At a pitch of exactly +-90 degrees roll and yaw turn about the same axis; roll is then 0 and
        yaw carries both.
        """
        # atan2 keeps full precision near +-90 degrees, where asin loses half of the digits.
        cos_pitch = float(hypot(self.rotation[0, 0], self.rotation[1, 0]))
        pitch = float(arctan2(-self.rotation[2, 0], cos_pitch))
        # Below 8 eps the two entries are rounding residue of a pitch of exactly 90 degrees.
        if cos_pitch < 8 * np.finfo(np.float64).eps:
            return 0.0, pitch, float(arctan2(-self.rotation[0, 1], self.rotation[1, 1]))
        roll = float(arctan2(self.rotation[2, 1], self.rotation[2, 2]))
        yaw = float(arctan2(self.rotation[1, 0], self.rotation[0, 0]))
        return roll, pitch, yaw


LENS_FROM_MIRROR = Pose(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]), np.zeros(3))
"""Mirror frame of a camera without a mirror, in the frame of its lens: +z is the optical axis, +x
the top of the image, +y its right. Of a camera that looks straight down with forward up it has the
robot's axes."""
