"""Interface of the mirrors: a radial projection with a surface and a capture camera on the axis.

The mirror frame has its origin at the effective viewpoint and +z towards the pinhole. A central
mirror reflects to the pinhole exactly the rays through the viewpoint. Another mirror has no such
point: its rays miss the origin, which is then the point on the axis from which the image looks most
alike, and its projection is that of scene points at infinity.
"""

from __future__ import annotations

from typing import Protocol

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import NO_FOLD, RadialProjection


class Mirror(RadialProjection, Protocol):
    """Mirror with a capture camera, both symmetric about one axis."""

    @property
    def is_central(self) -> bool:
        """Whether all scene rays meet in the effective viewpoint."""

    @property
    def pinhole_distance_m(self) -> float:
        """Distance from viewpoint to pinhole; inf for a telecentric camera."""

    def surface_point(self, t: Floats) -> tuple[Floats, Floats]:
        """Mirror point (r, z), in metres, that reflects scene rays of half-angle tangent t."""


class CentralMirror:
    """Base of the mirrors with a single effective viewpoint."""

    __slots__ = ()

    @property
    def is_central(self) -> bool:
        """True: all scene rays meet in the viewpoint."""
        return True

    @property
    def t_min(self) -> float:
        """0: the image's centre shows the axis."""
        return 0.0

    @property
    def fold_rad(self) -> float:
        """Infinity: the image radius grows up to the limit."""
        return NO_FOLD
