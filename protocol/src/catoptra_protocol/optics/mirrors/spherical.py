"""Spherical mirror under a pinhole camera: a chrome ball, a dome, a garden globe.

With the pinhole at d from the centre of a sphere of radius R: sin(i) = d sin(psi) / R is the angle
of incidence, theta = 2 i - psi. Not central. Domain: to grazing incidence, sin(psi) = R / d.
Source: law of reflection; Baker & Nayar, IJCV 35 (1999), section 3.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import arcsin, cos, sin
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror, Reflection, check_rim
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class SphericalMirror(NonCentralMirror):
    """Sphere by its radius, and the pinhole by its distance from the centre."""

    radius_m: float
    """Radius of the sphere, > 0."""
    centre_distance_m: float
    """Distance from the sphere's centre to the pinhole, above the radius."""
    rim_rad: float = math.radians(120.0)
    """Angle of the scene ray at the mirror's edge."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.radius_m) and self.radius_m > 0.0):
            raise DomainError(f"a spherical mirror needs a radius > 0, not {self.radius_m!r}")
        if not (math.isfinite(self.centre_distance_m) and self.centre_distance_m > self.radius_m):
            raise DomainError(
                f"the pinhole must lie outside the sphere: {self.centre_distance_m!r} m from the "
                f"centre of a radius of {self.radius_m!r} m"
            )
        check_rim(self)

    @property
    def psi_limit(self) -> float:
        """Camera angle of the sphere's outline."""
        return arcsin(self.radius_m / self.centre_distance_m)

    def reflect(self, psi: Floats) -> Reflection:
        """Reflect camera rays. Domain: 0 <= psi <= psi_limit."""
        sine, cosine = sin(psi), cos(psi)
        ratio = self.centre_distance_m / self.radius_m
        sine_i = np.minimum(ratio * sine, 1.0)
        cosine_i = np.sqrt((1.0 - sine_i) * (1.0 + sine_i))
        # The nearer intersection by a quotient of sums: the difference cancels next to the axis.
        reach = (self.centre_distance_m - self.radius_m) * (self.centre_distance_m + self.radius_m)
        distance = reach / (self.centre_distance_m * cosine + self.radius_m * cosine_i)
        with np.errstate(divide="ignore"):
            slope = 2.0 * ratio * cosine / cosine_i - 1.0
        theta = 2.0 * arcsin(sine_i) - psi
        return Reflection(theta, slope, distance * sine, distance * cosine)
