"""Where places on a mirror's surface appear in the picture, and how large.

Rings of a mirror by their radius, from its middle to its rim: the share of the surface within them,
their radius in the image, and how many pixels a metre takes there: of the surface along the radius,
of the radius itself, and across it. Between rings straight: within 1e-5 of their values. Domain:
central mirrors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera

_NUM_RINGS = 1025


@dataclass(frozen=True, slots=True, eq=False)
class MirrorSurfaceTable:
    """(n,) rings. r_m: radius about the axis. share: of the surface, within. radius_px: in the
    image. along, across: px a metre of the surface. outward: px a metre of the radius. area_m2: of
    the whole surface.
    """

    r_m: Floats
    area_fraction: Floats
    image_radius_px: Floats
    radial_px_per_m: Floats
    tangential_px_per_m: Floats
    plan_radial_px_per_m: Floats
    area_m2: float

    @property
    def max_px_per_m(self) -> float:
        """Return the largest scale in any direction."""
        return float(max(self.plan_radial_px_per_m.max(), self.tangential_px_per_m.max()))

    @property
    def max_px2_per_m2(self) -> float:
        """Return the largest scale of areas."""
        return float((self.radial_px_per_m * self.tangential_px_per_m).max())

    def r_from_area_fraction(self, area_fraction: Floats) -> Floats:
        """Return the radius within which a share of the surface lies."""
        # Areas grow by the square of the radius: their roots are straight in it.
        r: Floats = np.interp(np.sqrt(area_fraction), np.sqrt(self.area_fraction), self.r_m)
        return r

    def interpolate(self, r_m: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the image radius, and the scales along and across it."""
        radius, along, across = (
            np.interp(r_m, self.r_m, values)
            for values in (self.image_radius_px, self.radial_px_per_m, self.tangential_px_per_m)
        )
        return radius, along, across


@lru_cache(maxsize=4)
def mirror_surface_table(camera: OmniCamera) -> MirrorSurfaceTable:
    """Return the chart of a camera's mirror."""
    t = np.linspace(0.0, camera.rim_t, _NUM_RINGS)
    r, z = camera.mirror.surface_point(t)
    radius_px = camera.horizon_radius_px * camera.mirror.radius_ratio_from_t(t)
    arc = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(r), np.diff(z)))))
    rings = np.pi * (r[1:] + r[:-1]) * np.diff(arc)
    area = np.concatenate(([0.0], np.cumsum(rings)))
    along = np.gradient(radius_px, arc, edge_order=2)
    across = np.concatenate((along[:1], radius_px[1:] / r[1:]))
    return MirrorSurfaceTable(
        r_m=r,
        area_fraction=area / area[-1],
        image_radius_px=radius_px,
        radial_px_per_m=along,
        tangential_px_per_m=across,
        plan_radial_px_per_m=np.gradient(radius_px, r, edge_order=2),
        area_m2=float(area[-1]),
    )
