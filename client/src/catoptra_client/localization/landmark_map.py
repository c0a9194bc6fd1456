"""Where the landmarks stand: what the filter looks up when the detector names one.

Positions are level coordinates in the world frame. What a landmark looks like is no concern of the
filter; that stays in `catoptra_protocol.landmarks`.
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
    """A landmark's name and its place in the world: a beacon's axis, the middle of a goal's mouth.

    x_m, y_m: world frame.
    """

    name: str
    x_m: float
    y_m: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.x_m) and math.isfinite(self.y_m)):
            raise DomainError(f"landmark {self.name!r} stands nowhere: {self.x_m!r}, {self.y_m!r}")


LandmarkMap = Mapping[str, LandmarkPosition]


def make_landmark_map(landmarks: Iterable[Landmark]) -> LandmarkMap:
    """Return the read-only map from name to position of rows of the landmark file."""
    return MappingProxyType(
        {row.name: LandmarkPosition(row.name, row.x_m, row.y_m) for row in landmarks}
    )


def find_landmark_position(landmark_map: LandmarkMap, name: str) -> LandmarkPosition:
    """Return the position of a named landmark. Raises DomainError that lists the known names."""
    try:
        return landmark_map[name]
    except KeyError:
        names = ", ".join(sorted(landmark_map)) or "none"
        raise DomainError(f"no landmark {name!r} in the map; it has: {names}") from None
