"""Equiangular mirror: each degree of the camera sees the same number of degrees of the scene.

theta = g psi with the gain g. The surface about the pinhole is D(psi) = D0 cos((1 + g) psi /
2)^(-2 / (1 + g)). Not central. Domain: theta below 180 g / (1 + g) degrees. Source: Chahl &
Srinivasan, Applied Optics 36 (1997); Ollis, Herman & Singh, CMU-RI-TR-99-04.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import cos, power, sin
from catoptra_protocol.optics.mirrors.non_central import (
    NonCentralMirror,
    Reflection,
    check_rim,
    check_vertex_distance,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class EquiangularMirror(NonCentralMirror):
    """Mirror by its angular gain, and the pinhole by its distance from the vertex."""

    gain: float
    """d(theta) / d(psi), > 1; a plane has 1."""
    vertex_distance_m: float
    """Distance from the vertex to the pinhole, > 0."""
    rim_rad: float = math.radians(120.0)
    """Angle of the scene ray at the mirror's edge."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.gain) and self.gain > 1.0):
            raise DomainError(f"an equiangular mirror needs a gain > 1, not {self.gain!r}")
        check_vertex_distance(self.vertex_distance_m)
        check_rim(self)

    @property
    def psi_limit(self) -> float:
        """Camera angle of the surface's asymptote."""
        return math.pi / (1.0 + self.gain)

    def reflect(self, psi: Floats) -> Reflection:
        """Reflect camera rays. Domain: 0 <= psi < psi_limit."""
        total = 1.0 + self.gain
        distance = self.vertex_distance_m * power(cos(0.5 * total * psi), -2.0 / total)
        slope = np.full_like(psi, self.gain)
        return Reflection(self.gain * psi, slope, distance * sin(psi), distance * cos(psi))
