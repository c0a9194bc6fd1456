"""Position in the image and image scale of points on a mirror's own surface.

Rings of the mirror from the axis to the rim, by plan radius: the fraction of the surface within,
the image radius, and px per metre along the meridian, along the plan radius, and tangentially.
Linear between rings, within 1e-5 of the exact values. Domain: central mirrors.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass

_NUM_RINGS = 1025


@dataclass(frozen=True, slots=True, eq=False)
class MirrorSurfaceTable:
    """Table of (n,) rings of a mirror, from the axis to the rim."""

    r_m: Floats
    """Radius about the axis, in plan."""
    area_fraction: Floats
    """Fraction of the surface within the ring."""
    image_radius_px: Floats
    """Radius in the image."""
    radial_px_per_m: Floats
    """Image px per metre of surface, along the meridian."""
    tangential_px_per_m: Floats
    """Image px per metre of surface, around the axis."""
    plan_radial_px_per_m: Floats
    """Image px per metre of the plan radius."""
    area_m2: float
    """Area of the whole surface."""

    @property
    def max_px_per_m(self) -> float:
        """Largest scale of lengths in plan, in any direction."""
        return float(max(self.plan_radial_px_per_m.max(), self.tangential_px_per_m.max()))

    @property
    def max_px2_per_m2(self) -> float:
        """Largest scale of areas of the surface."""
        return float((self.radial_px_per_m * self.tangential_px_per_m).max())

    def r_from_area_fraction(self, area_fraction: Floats) -> Floats:
        """Plan radius, m, within which a fraction of the surface lies."""
        # Near the axis areas grow with the square of the radius: in the square roots the relation
        # is nearly linear and interpolates well.
        r: Floats = np.interp(np.sqrt(area_fraction), np.sqrt(self.area_fraction), self.r_m)
        return r

    def interpolate(self, r_m: Floats) -> tuple[Floats, Floats, Floats]:
        """Image radius in px, radial and tangential px per metre of surface, at plan radii."""
        radius, radial, tangential = (
            np.interp(r_m, self.r_m, values)
            for values in (self.image_radius_px, self.radial_px_per_m, self.tangential_px_per_m)
        )
        return radius, radial, tangential


@lru_cache(maxsize=4)
def mirror_surface_table(camera: OmniCamera) -> MirrorSurfaceTable:
    """Surface table of a camera's mirror."""
    t = np.linspace(0.0, camera.rim_t, _NUM_RINGS)
    r, z = camera.mirror.surface_point(t)
    radius_px = camera.scale_px * camera.projection.radius_ratio_from_t(t)
    arc = np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(r), np.diff(z)))))
    # Exact lateral areas of the cone frusta between rings.
    rings = np.pi * (r[1:] + r[:-1]) * np.diff(arc)
    area = np.concatenate(([0.0], np.cumsum(rings)))
    radial = np.gradient(radius_px, arc, edge_order=2)
    # On the axis both scales agree by symmetry, where the quotient would be 0 / 0.
    tangential = np.concatenate((radial[:1], radius_px[1:] / r[1:]))
    return MirrorSurfaceTable(
        r_m=r,
        area_fraction=area / area[-1],
        image_radius_px=radius_px,
        radial_px_per_m=radial,
        tangential_px_per_m=tangential,
        plan_radial_px_per_m=np.gradient(radius_px, r, edge_order=2),
        area_m2=float(area[-1]),
    )
