"""Interface of the central mirrors, in the half-angle tangent t = tan(theta / 2).

theta is the incidence angle, between the scene ray at the effective viewpoint and the optical axis
(viewpoint to pinhole): 0 is the image centre, 90 degrees the horizon. In t the projection has no
cancellation from the axis to the asymptote, and t = 1 is the horizon exactly.
"""

from __future__ import annotations

from typing import Protocol

from catoptra_protocol.optics.numerics import Floats


class CentralMirror(Protocol):
    """Mirror and capture camera with a single effective viewpoint."""

    @property
    def t_limit(self) -> float:
        """Value of t that rays approach but never reach (the asymptote); inf if there is none."""

    @property
    def pinhole_distance_m(self) -> float:
        """Distance from viewpoint to pinhole; inf for an orthographic camera."""

    def radius_ratio_from_t(self, t: Floats) -> Floats:
        """Image radius in units of the 90-degree circle h. Domain: 0 <= t < t_limit."""

    def t_from_radius_ratio(self, ratio: Floats) -> Floats:
        """Half-angle tangent of an image radius in units of h. Domain: ratio >= 0."""

    def radius_ratio_slope(self, t: Floats) -> Floats:
        """Derivative d(radius ratio) / d(theta), per radian."""

    def surface_point(self, t: Floats) -> tuple[Floats, Floats]:
        """Mirror point (r, z), in metres, that reflects scene rays of half-angle tangent t."""
