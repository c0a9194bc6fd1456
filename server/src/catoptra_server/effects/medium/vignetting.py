"""Vignetting: a camera's lens darkens the image towards its border.

A thin lens by cos^4 of the angle psi of a pixel's chief ray at the pinhole, tan(psi) = r / f in
pixels. A mirror preserves radiance, so only the lens of its capture camera shades. A wide-angle
lens without a mirror by the solid angle that a pixel sees. Source: `optics/image_plane`. Domain:
all pixels; a telecentric capture camera has psi = 0 everywhere and no vignetting. Criterion: the
largest loss of white, in encoded grey levels.
"""

from __future__ import annotations

from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    AVERAGING,
    CaptureContext,
    EffectBound,
    EffectType,
    Gains,
    Real,
    SceneSummary,
)
from catoptra_server.effects.kernels.grey_levels import max_change_by_factors
from catoptra_server.effects.kernels.lens_blur import map_of_radius

# Radii of the bound: between them the gain of 60 degrees off the axis bends by 1e-5.
_NUM_RADII = 201


@dataclass(frozen=True, slots=True)
class Vignetting:
    """Natural shading. No parameters: camera and image size determine the angles."""

    name: ClassVar[str] = "Vignetting"
    changes_scene: ClassVar[bool] = False
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance", "exposes_itself"})
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Loss of the brightest light at the rim, in grey levels."""
        # At a mirror's rim and not in the image's corners: pixels outside the mirror are black.
        gains = camera.relative_illumination(np.linspace(0.0, camera.rim_radius_px, _NUM_RADII))
        # A gain below 1 changes the brightest light most.
        value = max_change_by_factors(float(gains.min()), 1.0, summary)
        loss = 100.0 * (1.0 - float(gains.min()))
        return EffectBound(value, f"the image loses up to {loss:.2g} % of its light to its border")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: on the axis nothing is lost."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Darken the image."""
        return image * vignetting_map(camera).astype(image.dtype)


@lru_cache(maxsize=4)
def vignetting_map(camera: RadialCamera) -> Floats:
    """Factor of each pixel centre, (h, w, 1)."""
    factor = map_of_radius(
        camera, lambda r: camera.relative_illumination(np.minimum(r, camera.rim_radius_px))
    )[..., None]
    factor.setflags(write=False)
    return factor


EFFECT_TYPE = EffectType("Vignetting", Vignetting)
