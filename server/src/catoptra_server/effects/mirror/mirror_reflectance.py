"""Mirror reflectance: the reflectance of a metal depends on the angle of incidence.

L' = L R(i) / R(0), R the reflectance of a metal of complex index n - ik for unpolarized light, i
the angle between ray and normal: i = (theta + psi) / 2, theta the incidence angle at the viewpoint,
psi the angle at the pinhole. Relative to R(0), since the exposure compensates a loss that all
pixels share. Source: Fresnel's equations with a complex index. Domain: central mirrors, grey metals
(one index for all colours); beyond the rim the rim's value. Criterion: the change of white at the
angle that changes white most (in linear levels 255 (R_max - R_min)).
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import arctan, cos, hypot, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    NEEDS_MIRROR,
    CaptureContext,
    EffectBound,
    EffectParameter,
    EffectType,
    Gains,
    Real,
    SceneSummary,
)
from catoptra_server.effects.kernels.grey_levels import max_change_by_factors
from catoptra_server.effects.kernels.lens_blur import map_of_radius

# Radii of the bound: between them the reflectance of steel in the paper's mirror bends by 6e-7.
_NUM_RADII = 201


@dataclass(frozen=True, slots=True)
class MirrorReflectance:
    """Complex refractive index of the mirror's metal."""

    refractive_index: float
    """Real part n."""
    extinction_coefficient: float
    """Imaginary part k."""

    name: ClassVar[str] = "MirrorReflectance"
    changes_scene: ClassVar[bool] = False
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance", "exposes_itself"})
    needs_range: ClassVar[bool] = False

    @property
    def gains(self) -> Gains:
        """No metal reflects more than all of the light."""
        return 0.0, 1.0 / float(self.reflectance(np.array(0.0)))

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Largest change of the brightest light at any angle of incidence."""
        assert isinstance(camera, OmniCamera), NEEDS_MIRROR
        # All radii, not the ends: metals have a minimum of R between normal and grazing incidence.
        gains = self._relative_reflectance(np.linspace(0.0, 1.0, _NUM_RADII), camera)
        value = max_change_by_factors(float(gains.min()), float(gains.max()), summary)
        angle = math.degrees(float(_mirror_incidence_rad(np.array(1.0), camera)))
        return EffectBound(value, f"light meets the mirror at up to {angle:.0f} degrees")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of a mirror that reflects everything at grazing incidence."""
        # R <= 1 holds at all angles, so the camera need not be known here.
        normal = float(self.reflectance(np.array(0.0)))
        return replace(summary, max_radiance=(1.0 / normal) * summary.max_radiance)

    def reflectance(self, incidence_rad: Floats) -> Floats:
        """Reflectance for unpolarized light at angles between ray and normal."""
        cosine = cos(incidence_rad)
        n, k = self.refractive_index, self.extinction_coefficient
        # Of (n - ik)^2, and of what Snell's law takes the root of.
        real, imaginary = (n - k) * (n + k), -2.0 * n * k
        under_root = real - np.square(sin(incidence_rad))
        larger = np.sqrt(0.5 * (hypot(under_root, imaginary) + np.abs(under_root)))
        smaller = np.abs(0.5 * imaginary) / np.where(larger > 0.0, larger, 1.0)
        # n - ik times the cosine of the refracted ray.
        inside = np.where(under_root >= 0.0, larger, smaller)
        decay = -np.where(under_root >= 0.0, smaller, larger)
        s_polarized = _squared_ratio(cosine, inside, 0.0, decay)
        p_polarized = _squared_ratio(real * cosine, inside, imaginary * cosine, decay)
        return 0.5 * (s_polarized + p_polarized)

    def _relative_reflectance(self, radius_fraction: Floats, camera: OmniCamera) -> Floats:
        incidence_rad = _mirror_incidence_rad(radius_fraction, camera)
        return self.reflectance(incidence_rad) / self.reflectance(np.array(0.0))

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Multiply the image by the relative reflectance."""
        assert isinstance(camera, OmniCamera), NEEDS_MIRROR
        return image * reflectance_map(self, camera).astype(image.dtype)


def _squared_ratio(a: Floats, b: Floats, c: Floats | float, d: Floats) -> Floats:
    """|(a + ic) - (b + id)|^2 / |(a + ic) + (b + id)|^2."""
    above: Floats = np.square(a - b) + np.square(c - d)
    ratio: Floats = above / (np.square(a + b) + np.square(c + d))
    return ratio


def _mirror_incidence_rad(radius_fraction: Floats, camera: OmniCamera) -> Floats:
    """Angle of incidence on the mirror at fractions of the rim's image radius."""
    radius_px = radius_fraction * camera.rim_radius_px
    t = camera.projection.t_from_radius_ratio(radius_px / camera.scale_px)
    # Half of theta + psi; t is tan(theta / 2) already.
    psi = arctan(radius_px * camera.inverse_focal_length)
    angle: Floats = arctan(t) + 0.5 * psi
    return angle


@lru_cache(maxsize=4)
def reflectance_map(effect: MirrorReflectance, camera: OmniCamera) -> Floats:
    """Factor of each pixel centre, (h, w, 1)."""
    rim_px = camera.rim_radius_px
    gains = map_of_radius(
        camera, lambda r: effect._relative_reflectance(np.minimum(r / rim_px, 1.0), camera)
    )[..., None]
    gains.setflags(write=False)
    return gains


EFFECT_TYPE = EffectType(
    "MirrorReflectance",
    MirrorReflectance,
    (
        # Approximately aluminium's in green light.
        EffectParameter("MirrorIndex", "refractive_index", 0.96, 0.01, 10.0),
        EffectParameter("MirrorExtinction", "extinction_coefficient", 6.7, 0.0, 20.0),
    ),
    needs_mirror=True,
)
