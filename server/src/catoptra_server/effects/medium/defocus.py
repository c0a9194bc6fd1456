"""Defocus: the mirror's virtual image is curved, and the lens is sharp at one depth only.

Every pixel is the mean of a uniform disc around it, with the diameter of infinity at its image
radius: |infinity_diameter_px| of `lens_blur`, where the optics are derived. No range is needed: in
a mirror everything beyond half a metre has nearly this disc, and without one everything beyond the
hyperfocal distance. Nearer objects are the domain of `DefocusByDepth`, which then does all of the
blur and supersedes this effect. Kernels: `convolution`. Domain: as of `lens_blur`; at a depth
discontinuity the pixel's own disc counts, not its neighbour's. An edge within a pixel is blurred as
if the whole pixel had its mean: of the real camera's pixels at F/4 and F/2, 88 to 99 % are within 2
grey levels of 256 rays through the aperture, and 98.6 to 100 % within 8, by world
(tests/server/render/test_defocus_of_real_camera.py). Criterion: the light that the largest disc of
anything in view, near or far, takes from other pixels, times the contrast of black and the
brightest.
"""

from __future__ import annotations

from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    AVERAGING,
    CaptureContext,
    EffectBound,
    EffectParameter,
    EffectType,
    Gains,
    Real,
    SceneSummary,
)
from catoptra_server.effects.kernels.convolution import (
    DiscKernelTable,
    convolve_symmetric_within,
    disc_kernel_table,
    table_row,
)
from catoptra_server.effects.kernels.grey_levels import max_change_by_exchange
from catoptra_server.effects.kernels.lens_blur import (
    DISTANCE_FIELDS,
    Aperture,
    circle_of_confusion,
    circle_of_confusion_map,
    describe_lens,
    interior_mask,
    max_diameter_px,
    min_distance_at_radius,
    sample_radii_px,
)


@dataclass(frozen=True, slots=True)
class Defocus:
    """Defocus of a lens by image radius alone."""

    aperture: Aperture

    name: ClassVar[str] = "Defocus"
    changes_scene: ClassVar[bool] = False
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = DISTANCE_FIELDS | {"max_radiance"}
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Bound the change by the largest disc of anything in view."""
        # Near discs count, too: this bound is then never below DefocusByDepth's, for which
        # this effect stands in where both discs differ by less than the threshold.
        radius_px = sample_radii_px(camera)
        circle = circle_of_confusion(self.aperture, camera, radius_px)
        near_px = circle.diameter_px(min_distance_at_radius(summary, camera, radius_px))
        far_px = np.abs(circle.infinity_diameter_px)
        largest_px = float(np.maximum(far_px, near_px).max())
        lens = describe_lens(self.aperture, camera)
        return EffectBound(
            max_change_by_exchange(
                disc_kernel_table(largest_px).max_exchange(0.0, largest_px),
                summary.picture_radiance,
            ),
            f"{lens}: discs of up to {float(far_px.max()):.2g} px at infinity",
            largest_px,
        )

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: a weighted mean is not brighter than its brightest pixel."""
        return summary

    def kernel_table(self, camera: RadialCamera) -> DiscKernelTable:
        """Kernels of infinity's discs at all image radii."""
        return disc_kernel_table(_largest_disc_px(self, camera))

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Blur the image."""
        weights = _kernel_weights(self, camera, image.dtype)
        half_width_px = self.kernel_table(camera).half_width_px
        # Within the mirror alone: the black around it would otherwise darken the rim.
        return convolve_symmetric_within(
            image, interior_mask(camera), half_width_px, lambda rows: weights[:, rows]
        )


@lru_cache(maxsize=4)
def _largest_disc_px(effect: Defocus, camera: RadialCamera) -> float:
    """Diameter of infinity's largest disc, of those that are drawn."""
    circle = circle_of_confusion_map(effect.aperture, camera)
    diameter_px = float(np.abs(circle.infinity_diameter_px).max())
    return min(diameter_px, max_diameter_px(effect.aperture, camera))


@lru_cache(maxsize=2)
def _kernel_weights(
    effect: Defocus, camera: RadialCamera, dtype: np.dtype[Real]
) -> npt.NDArray[Real]:
    """Weights of every pixel, (pairs, h, w)."""
    # Only two entries: at 640 px and a kernel of 15 pairs one takes 25 MB in float32.
    table = effect.kernel_table(camera)
    row = table_row(circle_of_confusion_map(effect.aperture, camera).infinity_diameter_px)
    weights: npt.NDArray[Real] = table.interpolate(row, table.half_width_px).astype(dtype)
    weights.setflags(write=False)
    return weights


# Keys that Diffraction and MirrorDust share: one lens, whichever effects a robot file names.
F_NUMBER = EffectParameter("FNumber", "f_number", 4.0, 0.7, 64.0)
PIXEL_PITCH = EffectParameter("PixelPitch", "pixel_pitch_m", 7.4e-6, 1e-7, 1e-3)
# 0: the focus that minimizes the largest disc of infinity.
_FOCUS_DISTANCE = EffectParameter("FocusDistance", "focus_distance_m", 0.0, 0.0, 1000.0)
APERTURE_PARAMETERS = (F_NUMBER, PIXEL_PITCH, _FOCUS_DISTANCE)


def _create_effect(f_number: float, pixel_pitch_m: float, focus_distance_m: float) -> Defocus:
    return Defocus(Aperture(f_number, pixel_pitch_m, focus_distance_m))


EFFECT_TYPE = EffectType("Defocus", _create_effect, APERTURE_PARAMETERS, needs_viewpoint=True)
