"""Interface of the projections whose image radius depends on the angle from the axis alone.

theta is the angle between a scene ray and the optical axis: 0 on the axis, 90 degrees at a mirror's
horizon. Projections are functions of t = tan(theta / 2), in which none cancels from the axis to the
antipode; t = 1 is 90 degrees exactly. Image radii are in units of the projection: of the 90-degree
circle h for mirrors, of the focal length for lenses; `OmniCamera.scale_px` is that unit in pixels.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from catoptra_protocol.optics.numerics import Floats


class RadialProjection(Protocol):
    """Image radius of an angle from the axis, and its inverse."""

    def __hash__(self) -> int:
        """Hash of the parameters: maps of an image are cached by camera."""

    @property
    def t_min(self) -> float:
        """Half-angle tangent in the image's centre: 0 but for a cone, which does not show its
        axis."""

    @property
    def t_limit(self) -> float:
        """Value of t that the image ends before: the formula's limit or its first fold; inf if the
        image contains the antipode."""

    @property
    def fold_rad(self) -> float:
        """Angle at which the image radius first turns back, radians; inf if it never does."""

    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Image radius in the projection's unit. Domain: t_min <= t < t_limit."""

    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of an image radius, inf beyond the last. Domain: ratio >= 0."""

    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(radius ratio) / d(theta), per radian."""


NO_FOLD = math.inf
"""`fold_rad` of a projection that never turns back."""

WITHIN_LIMIT = 1.0 - 1e-9
"""Of an angle at a fold or a formula's limit, where the image radius stops growing: a rim there."""


def describe_limit(projection: RadialProjection) -> str:
    """Where the image of a projection ends, in words: for errors."""
    limit = math.degrees(2.0 * math.atan(projection.t_limit))
    if math.isinf(projection.fold_rad):
        return f"{limit:.3f} deg"
    text = f"{limit:.3f} deg, where its image radius turns back (its first fold)"
    formula_t = getattr(projection, "formula_t_limit", projection.t_limit)
    if formula_t <= projection.t_limit:
        return text
    return f"{text}, although its formula reaches {math.degrees(2.0 * math.atan(formula_t)):.1f}"


def largest_angle_rad(projection: RadialProjection, ratio: float) -> float:
    """Angle of an image radius, or the limit of the projection where that is smaller."""
    t = float(projection.t_from_radius_ratio(np.array(ratio)))
    corner_rad = 2.0 * math.atan(t)
    if math.isinf(projection.t_limit):
        return min(corner_rad, math.pi)
    return min(corner_rad, 2.0 * math.atan(projection.t_limit) * WITHIN_LIMIT)
