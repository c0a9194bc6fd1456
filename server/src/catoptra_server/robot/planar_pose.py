"""Where a robot stands on its floor."""

from __future__ import annotations

from dataclasses import dataclass

from catoptra_protocol.optics.transforms import Pose


@dataclass(frozen=True, slots=True)
class PlanarPose:
    """A place on a level floor: x, y in metres, yaw in radians, clockwise from above (SAE)."""

    x_m: float
    y_m: float
    yaw_rad: float

    def at_height(self, height_m: float) -> Pose:
        """Return world_from_robot for a frame that rides at a height above the floor z = 0."""
        return Pose.from_rpy((self.x_m, self.y_m, -height_m), (0.0, 0.0, self.yaw_rad))
