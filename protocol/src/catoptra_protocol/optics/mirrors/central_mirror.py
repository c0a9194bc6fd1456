"""What every central mirror answers. All of it in t = tan(theta / 2).

theta is the incidence angle: between the scene ray at the effective viewpoint and the optical axis
(viewpoint to pinhole); 0 = image centre, 90 degrees = horizon. In t the law has no cancellation
from the axis to the asymptote, and t = 1 is the horizon exactly.
"""

from __future__ import annotations

from typing import Protocol

from catoptra_protocol.optics.numerics import Floats


class CentralMirror(Protocol):
    """A mirror and capture camera with a single effective viewpoint."""

    @property
    def t_limit(self) -> float:
        """Return the t that rays approach but never reach (the asymptote); inf if there is none."""

    @property
    def pinhole_distance_m(self) -> float:
        """Return the distance from viewpoint to pinhole; inf for an orthographic camera."""

    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Return the image radius in units of the 90-degree circle h. Domain: 0 <= t < t_limit."""

    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Return t of an image radius in units of h. Domain: ratio >= 0."""

    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Return d(radius ratio) / d(theta), per radian."""

    def surface_point(self, t: Floats) -> tuple[Floats, Floats]:
        """Return (r, z) in metres of the mirror point that a scene ray of t meets."""
