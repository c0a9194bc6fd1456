"""Landmark map: positions by name, for the filter.

Positions are level coordinates in the world frame. Shape and colours of landmarks are in
`catoptra_protocol.landmarks`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from catoptra_protocol.errors import DomainError
from catoptra_protocol.landmarks import Landmark


@dataclass(frozen=True, slots=True)
class LandmarkPosition:
    """Position of a landmark: the axis of a beacon, the centre of a goal's mouth."""

    name: str
    """Name in the landmark file."""
    x_m: float
    """World frame x."""
    y_m: float
    """World frame y."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.x_m) and math.isfinite(self.y_m)):
            raise DomainError(
                f"landmark {self.name!r} has no finite position: {self.x_m!r}, {self.y_m!r}"
            )


LandmarkMap = Mapping[str, LandmarkPosition]


def make_landmark_map(landmarks: Iterable[Landmark]) -> LandmarkMap:
    """Read-only map from name to position, of the rows of a landmark file."""
    return MappingProxyType(
        {row.name: LandmarkPosition(row.name, row.x_m, row.y_m) for row in landmarks}
    )


def find_landmark_position(landmark_map: LandmarkMap, name: str) -> LandmarkPosition:
    """Position of a landmark by name.

    Raises:
        DomainError: the map lacks the name; the message lists the names.
    """
    try:
        return landmark_map[name]
    except KeyError:
        names = ", ".join(sorted(landmark_map)) or "none"
        raise DomainError(f"no landmark {name!r} in the map; it has: {names}") from None
