"""Vignetting: the capture camera's lens darkens the picture towards its border, cos^4 psi.

E = L cos^4(psi), psi the angle between the optical axis and a pixel's chief ray at the pinhole:
tan(psi) = r / f in pixels, hence cos^4(psi) = 1 / (1 + (r / f)^2)^2. The mirror preserves radiance,
so the lens alone shades. Source: the cosine-fourth law of a thin lens. Domain: all pixels; an
orthographic capture camera has psi = 0 everywhere and no vignetting. Criterion: what white loses at
the rim, in encoded grey levels (in linear ones it would be 255 (1 - cos^4 psi_rim)).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
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
    EffectType,
    Real,
    Uniforms,
    float32_array,
)
from catoptra_server.effects.kernels.grey_levels import max_change_by_gain
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class Vignetting:
    """No numbers: the mirror and the picture give the angles."""

    name: ClassVar[str] = "Vignetting"
    unit: ClassVar[str] = GREY_LEVELS
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return what the brightest light loses at the rim."""
        tangent = camera.rim_radius_px * inverse_focal_length(camera)
        value = max_change_by_gain((1.0 + tangent**2) ** -2, summary.max_radiance)
        angle = math.degrees(math.atan(tangent))
        return EffectBound(value, f"the rim is seen {angle:.2f} degrees off the lens's axis")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: on the axis nothing is lost."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the darkened picture."""
        return image * cosine_fourth_map(camera).astype(image.dtype)

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return the middle and the focal length."""
        return {
            "centre_px": float32_array(*camera.centre_px),
            "inverse_focal": float32_array(inverse_focal_length(camera)),
        }


def inverse_focal_length(camera: OmniCamera) -> float:
    """Return 1 / f of the capture camera, 1/px: tan(psi) of a radius of 1 px; 0 = orthographic."""
    pinhole_m = camera.mirror.pinhole_distance_m
    if math.isinf(pinhole_m):
        return 0.0
    r, z = camera.mirror.surface_point(np.array(camera.rim_t))
    return float(r) / (pinhole_m - float(z)) / camera.rim_radius_px


@lru_cache(maxsize=4)
def cosine_fourth_map(camera: OmniCamera) -> Floats:
    """Return the (h, w, 1) factor of each pixel's middle."""
    u = np.arange(camera.width_px) + 0.5 - camera.centre_px[0]
    v = np.arange(camera.height_px) + 0.5 - camera.centre_px[1]
    tangent2 = (u[None, :] ** 2 + v[:, None] ** 2) * inverse_focal_length(camera) ** 2
    factor: Floats = ((1.0 + tangent2) ** -2)[..., None]
    factor.setflags(write=False)
    return factor


EFFECT_TYPE = EffectType("Vignetting", Vignetting)
