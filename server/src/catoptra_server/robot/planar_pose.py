"""Position and heading of a robot on a level floor."""

from __future__ import annotations

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class PlanarPose:
    """Position in the plane z = 0, and yaw, clockwise seen from above (SAE)."""

    x_m: float
    y_m: float
    yaw_rad: float

    def at_height(self, height_m: float) -> Pose:
        """Transform to the world from an upright frame at a height above the floor."""
        # z points down: a frame above the floor has a negative z.
        return Pose.from_rpy((self.x_m, self.y_m, -height_m), (0.0, 0.0, self.yaw_rad))
