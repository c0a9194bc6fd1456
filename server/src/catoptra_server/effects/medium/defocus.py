"""Defocus: what the mirror shows lies on a curved surface, and the lens is sharp at one depth only.

Every pixel gathers the light of a uniform disc of its own diameter, that of infinity at its image
radius: |fixed_px| of `lens_blur`, where the optics are derived. No depth is needed: from half a
metre on all things have nearly this disc; what is nearer is `DefocusByDepth`'s, which then does all
of it and leaves nothing to this one. Kernels: `disc_kernel`. Domain: that of `lens_blur`; at a
border of depths the pixel's own disc counts, not its neighbour's. Criterion: the largest diameter
of all that is in view, near or far.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import (
    PIXELS,
    EffectBound,
    EffectParameter,
    EffectType,
    Real,
    Uniforms,
    float32_array,
)
from catoptra_server.effects.kernels.disc_kernel import (
    DiscKernelTable,
    disc_kernel_table,
    table_row,
)
from catoptra_server.effects.kernels.lens_blur import (
    Aperture,
    circle_of_confusion,
    circle_of_confusion_map,
    describe_lens,
    interior_mask,
    interior_radius_px,
    min_distance_at_radius,
    sample_radii_px,
)
from catoptra_server.effects.kernels.symmetric_kernels import convolve_symmetric_within
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class Defocus:
    """The lens and what it is focused at."""

    aperture: Aperture

    name: ClassVar[str] = "Defocus"
    unit: ClassVar[str] = PIXELS
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return the largest disc of what is in view."""
        radius = sample_radii_px(camera)
        law = circle_of_confusion(self.aperture, camera, radius)
        near = law.diameter_px(min_distance_at_radius(summary, camera, radius))
        value = float(np.maximum(np.abs(law.infinity_diameter_px), near).max())
        far = float(np.abs(law.infinity_diameter_px).max())
        lens = describe_lens(self.aperture, camera)
        return EffectBound(value, f"{lens}: discs of up to {far:.2g} px from afar")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: no pixel gets brighter than the brightest around it."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the blurred picture."""
        weights = _kernel_weights(self, camera, image.dtype)
        reach = _kernel_table(self, camera).half_width_px
        return convolve_symmetric_within(
            image, interior_mask(camera), reach, lambda rows: weights[:, rows]
        )

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return each pixel's row of the kernels' table, and the table."""
        return {
            "row": _table_row_map(self, camera),
            "weights": _kernel_table(self, camera).to_texture(),
            "centre_px": float32_array(*camera.centre_px),
            "whole_px": float32_array(interior_radius_px(camera)),
        }


def _kernel_table(effect: Defocus, camera: OmniCamera) -> DiscKernelTable:
    return disc_kernel_table(
        float(np.abs(circle_of_confusion_map(effect.aperture, camera).infinity_diameter_px).max())
    )


@lru_cache(maxsize=2)
def _kernel_weights(
    effect: Defocus, camera: OmniCamera, dtype: np.dtype[Real]
) -> npt.NDArray[Real]:
    """Return the (pairs, h, w) weights of every pixel."""
    table = _kernel_table(effect, camera)
    row = table_row(circle_of_confusion_map(effect.aperture, camera).infinity_diameter_px)
    weights: npt.NDArray[Real] = table.interpolate(row, table.half_width_px).astype(dtype)
    weights.setflags(write=False)
    return weights


@lru_cache(maxsize=4)
def _table_row_map(effect: Defocus, camera: OmniCamera) -> npt.NDArray[np.float32]:
    """Return the (h, w, 1) rows, with their fractions."""
    row: npt.NDArray[np.float32] = table_row(
        circle_of_confusion_map(effect.aperture, camera).infinity_diameter_px
    ).astype(np.float32)
    return row[..., None]


# Keys that `Diffraction` shares.
F_NUMBER = EffectParameter("FNumber", "f_number", 4.0, 0.7, 64.0)
PIXEL_PITCH = EffectParameter("PixelPitch", "pixel_pitch_m", 7.4e-6, 1e-7, 1e-3)
# 0: where the largest disc of what is far away is least.
FOCUS_DISTANCE = EffectParameter("FocusDistance", "focus_distance_m", 0.0, 0.0, 1000.0)
APERTURE_PARAMETERS = (F_NUMBER, PIXEL_PITCH, FOCUS_DISTANCE)


def _create_effect(f_number: float, pixel_pitch_m: float, focus_distance_m: float) -> Defocus:
    return Defocus(Aperture(f_number, pixel_pitch_m, focus_distance_m))


EFFECT_TYPE = EffectType("Defocus", _create_effect, APERTURE_PARAMETERS)
