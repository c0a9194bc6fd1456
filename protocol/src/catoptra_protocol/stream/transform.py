"""A rigid transform on the wire."""

from __future__ import annotations

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.vectors import Vector3

# Nine numbers rather than three rows: msgpack would spend a header on each row.
RotationRows = tuple[float, float, float, float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Transform:
    """A rigid transform parent_from_child."""

    position_m: Vector3
    """Origin of the child frame in the parent frame."""
    # A matrix has no convention to agree on, unlike a quaternion or three angles.
    rotation: RotationRows
    """Rotation matrix (3, 3), row by row."""
