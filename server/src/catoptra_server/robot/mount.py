"""Where an item of a robot file sits: a place in the frame of the part that carries it."""

from __future__ import annotations

from dataclasses import dataclass

from catoptra_protocol.optics.transforms import Pose

Vector3 = tuple[float, float, float]

# The mount that GEO names for what sits on the chassis itself.
CHASSIS = "HARD"


@dataclass(frozen=True, slots=True)
class Mount:
    """Position, and rotation as roll, pitch, yaw, in the frame of the parent; HARD = chassis."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    rotation_rad: Vector3 = (0.0, 0.0, 0.0)
    parent: str = CHASSIS

    def parent_from_item(self) -> Pose:
        """Return the place as a transform."""
        return Pose.from_rpy(self.position_m, self.rotation_rad)
