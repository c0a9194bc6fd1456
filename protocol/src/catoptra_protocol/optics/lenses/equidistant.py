"""Equidistant lens: the image radius is proportional to the angle from the axis, r = f theta.

Source: Miyamoto 1964; the law on most data sheets of fish-eye lenses ("f-theta"). Domain: 0 to 180
degrees.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.elementary import arctan, tan
from catoptra_protocol.optics.lenses.centred_lens import (
    CentredLens,
    require_angle,
    require_radius,
)
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class EquidistantLens(CentredLens):
    """Lens with r = f theta; it has no parameter but its focal length, which is the scale."""

    @property
    def t_limit(self) -> float:
        """Infinity: the image may contain the antipode, as a circle."""
        return math.inf

    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Ratio r / f = theta = 2 atan(t). Domain: t >= 0."""
        require_angle(t, self.t_limit)
        radius: Floats = 2.0 * arctan(t)
        return radius

    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent tan(r / 2f), inf from the antipode on. Domain: ratio >= 0."""
        require_radius(ratio)
        # tan is finite next to pi / 2 and negative beyond.
        half = 0.5 * np.minimum(ratio, math.pi)
        return np.where(ratio > math.pi, math.inf, tan(half))

    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(r / f) / d(theta) = 1. Domain: t >= 0."""
        require_angle(t, self.t_limit)
        return np.ones_like(t)
