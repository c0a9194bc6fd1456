"""Vignetting: a camera's lens darkens the image towards its border, cos^4 psi.

E = L cos^4(psi), psi the angle between the optical axis and a pixel's chief ray at the pinhole:
tan(psi) = r / f in pixels, hence cos^4(psi) = 1 / (1 + (r / f)^2)^2. A mirror preserves radiance,
so only the lens shades; without a mirror psi is the angle of the pixel's own direction. Source: the
cosine-fourth law of a thin lens. Domain: all pixels; an orthographic capture camera has psi = 0
everywhere and no vignetting. Criterion: the loss of white at the rim or in the corners, in encoded
grey levels (in linear ones 255 (1 - cos^4 psi_rim)).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import (
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
    """Cosine-fourth shading. No parameters: camera and image size determine the angles."""

    name: ClassVar[str] = "Vignetting"
    changes_scene: ClassVar[bool] = False
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Loss of the brightest light at the rim, in grey levels."""
        # At a mirror's rim and not in the image's corners: pixels outside the mirror are black.
        tangent = camera.rim_radius_px * camera.inverse_focal_length
        # A gain below 1 changes the brightest light most, and the rim has the smallest gain.
        value = max_change_by_gain((1.0 + tangent**2) ** -2, summary.max_radiance)
        angle = math.degrees(math.atan(tangent))
        return EffectBound(value, f"the image reaches {angle:.2f} degrees off the lens's axis")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: on the axis nothing is lost."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Darken the image."""
        return image * cosine_fourth_map(camera).astype(image.dtype)

    def uniforms(
        self,
        camera: RadialCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Image centre and focal length."""
        return {
            "centre_px": float32_array(*camera.centre_px),
            "inverse_focal_length": float32_array(camera.inverse_focal_length),
        }


@lru_cache(maxsize=4)
def cosine_fourth_map(camera: RadialCamera) -> Floats:
    """Factor of each pixel centre, (h, w, 1)."""
    u = np.arange(camera.width_px) + 0.5 - camera.centre_px[0]
    v = np.arange(camera.height_px) + 0.5 - camera.centre_px[1]
    # 1 / (1 + tan^2)^2 needs no arctangent and has no cancellation on the axis.
    tangent2 = (u[None, :] ** 2 + v[:, None] ** 2) * camera.inverse_focal_length**2
    factor: Floats = ((1.0 + tangent2) ** -2)[..., None]
    factor.setflags(write=False)
    return factor


EFFECT_TYPE = EffectType("Vignetting", Vignetting)
