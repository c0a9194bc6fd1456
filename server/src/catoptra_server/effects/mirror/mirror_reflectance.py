"""Mirror reflectance: a metal reflects a little less, or more, where light meets it obliquely.

L' = L R(i) / R(0), R the reflectance of a metal of complex index n - ik for unpolarised light, i
the angle between ray and normal: i = (theta + psi) / 2, theta the incidence at the viewpoint, psi
the angle at the pinhole. Over R(0), because the exposure makes up for what all pixels lose alike.
Source: Fresnel's equations with a complex index. Domain: central mirrors, grey metals (one index
for all colours); beyond the rim the rim's value. Criterion: the change of white at the angle where
it is largest (in linear levels 255 (R_max - R_min)).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import (
    GREY_LEVELS,
    EffectBound,
    EffectParameter,
    EffectType,
    Real,
    Uniforms,
    float32_array,
)
from catoptra_server.effects.kernels.grey_levels import max_change_by_gain
from catoptra_server.effects.medium.vignetting import inverse_focal_length
from catoptra_server.effects.scene_summary import SceneSummary

# The shader interpolates between so many radii, within 6e-7 for steel in the paper's mirror. Each
# may take the room of a vec4, of the 256 that OpenGL 3.3 promises.
_NUM_RADIAL_STEPS = 200


@dataclass(frozen=True, slots=True)
class MirrorReflectance:
    """n, k: the metal's refractive index and extinction."""

    refractive_index: float
    extinction_coefficient: float

    name: ClassVar[str] = "MirrorReflectance"
    unit: ClassVar[str] = GREY_LEVELS
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return the change of the brightest light at the angle that changes it most."""
        gains = self.relative_reflectances(camera)
        value = max(max_change_by_gain(float(g), summary.max_radiance) for g in gains)
        angle = math.degrees(float(mirror_incidence_rad(np.array(1.0), camera)))
        return EffectBound(value, f"light meets the mirror at up to {angle:.0f} degrees")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of a mirror that reflects all where it reflects most."""
        most = 1.0 / float(
            reflectance(np.array(0.0), self.refractive_index, self.extinction_coefficient)
        )
        return replace(summary, max_radiance=most * summary.max_radiance)

    def relative_reflectances(self, camera: OmniCamera) -> Floats:
        """Return R(i) / R(0) at `_STEPS` + 1 equal steps of the radius, centre to rim."""
        return self._relative_reflectance(np.linspace(0.0, 1.0, _NUM_RADIAL_STEPS + 1), camera)

    def _relative_reflectance(self, radius_fraction: Floats, camera: OmniCamera) -> Floats:
        straight = reflectance(np.array(0.0), self.refractive_index, self.extinction_coefficient)
        relative: Floats = (
            reflectance(
                mirror_incidence_rad(radius_fraction, camera),
                self.refractive_index,
                self.extinction_coefficient,
            )
            / straight
        )
        return relative

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the picture in the mirror of this metal."""
        return image * _gain_map(self, camera).astype(image.dtype)

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return the middle, the rim, and gains by radius."""
        return {
            "centre_px": float32_array(*camera.centre_px),
            "rim_px": float32_array(camera.rim_radius_px),
            "gains": float32_array(*_uniform_gains(self, camera)),
        }


def reflectance(incidence_rad: Floats, n: float, k: float) -> Floats:
    """Return the reflectance of a metal for unpolarised light at angles from the normal."""
    cosine = np.cos(incidence_rad)
    squared = complex(n, -k) ** 2
    inside = np.sqrt(squared - np.square(np.sin(incidence_rad)))
    across = (cosine - inside) / (cosine + inside)
    along = (squared * cosine - inside) / (squared * cosine + inside)
    mean: Floats = 0.5 * (np.abs(across) ** 2 + np.abs(along) ** 2)
    return mean


def mirror_incidence_rad(radius_fraction: Floats, camera: OmniCamera) -> Floats:
    """Return at what angle light meets the mirror, at shares of the rim's image radius."""
    radius_px = radius_fraction * camera.rim_radius_px
    t = camera.mirror.t_from_radius_ratio(radius_px / camera.horizon_radius_px)
    psi = np.arctan(radius_px * inverse_focal_length(camera))
    angle: Floats = np.arctan(t) + 0.5 * psi
    return angle


@lru_cache(maxsize=4)
def _uniform_gains(effect: MirrorReflectance, camera: OmniCamera) -> tuple[float, ...]:
    return tuple(effect.relative_reflectances(camera).tolist())


@lru_cache(maxsize=4)
def _gain_map(effect: MirrorReflectance, camera: OmniCamera) -> Floats:
    """Return the (h, w, 1) factor of each pixel's middle."""
    u = np.arange(camera.width_px) + 0.5 - camera.centre_px[0]
    v = np.arange(camera.height_px) + 0.5 - camera.centre_px[1]
    share = np.minimum(np.hypot(u[None, :], v[:, None]) / camera.rim_radius_px, 1.0)
    gains = effect._relative_reflectance(share, camera)[..., None]
    gains.setflags(write=False)
    return gains


EFFECT_TYPE = EffectType(
    "MirrorReflectance",
    MirrorReflectance,
    (
        # About those of aluminium in green light.
        EffectParameter("MirrorIndex", "refractive_index", 0.96, 0.01, 10.0),
        EffectParameter("MirrorExtinction", "extinction_coefficient", 6.7, 0.0, 20.0),
    ),
)
