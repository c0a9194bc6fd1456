"""Conical mirror under a pinhole camera, its apex towards the camera.

With the half angle alpha and the pinhole at d from the apex: theta = pi - 2 alpha + psi. Not
central: the viewpoints form a circle. The image's centre, the apex, shows no direction but a circle
of them at pi - 2 alpha; that pixel is invalid. Domain: psi below alpha. Source: law of reflection;
Baker & Nayar, IJCV 35 (1999), section 2.3.3.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import cos, sin, tan
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror, Reflection, check_rim
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class ConicalMirror(NonCentralMirror):
    """Cone by its half angle, and the pinhole by its distance from the apex."""

    half_angle_rad: float
    """Angle between axis and generator, between 0 and 90 degrees."""
    apex_distance_m: float
    """Distance from the apex to the pinhole, > 0."""
    rim_rad: float
    """Angle of the scene ray at the mirror's edge."""

    def __post_init__(self) -> None:
        if not 0.0 < self.half_angle_rad < 0.5 * math.pi:
            raise DomainError(
                f"a cone needs a half angle between 0 and 90 deg, not "
                f"{math.degrees(self.half_angle_rad):g}"
            )
        if not (math.isfinite(self.apex_distance_m) and self.apex_distance_m > 0.0):
            raise DomainError(
                f"the pinhole must lie before the apex: {self.apex_distance_m!r} m; at the apex "
                "only grazing rays are left"
            )
        check_rim(self)

    @property
    def t_min(self) -> float:
        """Half-angle tangent at the apex, cot(alpha)."""
        return 1.0 / tan(self.half_angle_rad)

    @property
    def psi_limit(self) -> float:
        """The half angle: beyond it camera rays miss the cone."""
        return self.half_angle_rad

    def reflect(self, psi: Floats) -> Reflection:
        """Reflect camera rays. Domain: 0 <= psi < psi_limit."""
        theta = math.pi - 2.0 * self.half_angle_rad + psi
        along = self.apex_distance_m * sin(psi) / sin(self.half_angle_rad - psi)
        sine, cosine = sin(self.half_angle_rad), cos(self.half_angle_rad)
        return Reflection(
            theta, np.ones_like(psi), along * sine, self.apex_distance_m + along * cosine
        )
