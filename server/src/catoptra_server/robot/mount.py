"""Mounting pose of an item of a robot file."""

from __future__ import annotations

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.geometry import CHASSIS_MOUNT
from catoptra_protocol.vectors import Vector3


@dataclass(frozen=True, slots=True)
class Mount:
    """Pose of an item in the frame of the parent."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    rotation_rad: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw."""
    parent: str = CHASSIS_MOUNT
    """Link that carries the item, or CHASSIS_MOUNT."""

    def parent_from_item(self) -> Pose:
        """Transform from the item's frame to the parent's."""
        return Pose.from_rpy(self.position_m, self.rotation_rad)
