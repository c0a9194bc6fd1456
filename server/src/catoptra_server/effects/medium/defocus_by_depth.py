"""Defocus with each pixel's own depth: for things so near that their disc differs from infinity's.

Every pixel gathers the light of a uniform disc of |fixed + near / (power range + offset)| px,
`lens_blur`'s law with the range of what its middle sees. It does all that `Defocus` does, and so
takes its place: what a disc of another width blurred before cannot be made sharp again. Robot files
that name both leave the choice to the two criteria. Domain: that of `Defocus`. Criterion: how far
the disc of the nearest thing in view differs from that of infinity, in px.
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
    PIXELS,
    EffectBound,
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
    CircleOfConfusion,
    circle_of_confusion,
    circle_of_confusion_map,
    describe_lens,
    interior_mask,
    interior_radius_px,
    max_diameter_px,
    min_distance_at_radius,
    sample_radii_px,
)
from catoptra_server.effects.kernels.symmetric_kernels import convolve_symmetric_within
from catoptra_server.effects.medium.defocus import APERTURE_PARAMETERS, Defocus
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class DefocusByDepth:
    """The lens and what it is focused at."""

    aperture: Aperture

    name: ClassVar[str] = "DefocusByDepth"
    unit: ClassVar[str] = PIXELS
    needs_range: ClassVar[bool] = True

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return by how much the disc of what is nearest differs from that of infinity."""
        radius = sample_radii_px(camera)
        law = circle_of_confusion(self.aperture, camera, radius)
        value = float(
            max_diameter_change_px(law, min_distance_at_radius(summary, camera, radius)).max()
        )
        nearest = min(summary.visible_min_distances_m)
        lens = describe_lens(self.aperture, camera)
        where = f"{nearest:.2g} m away" if math.isfinite(nearest) else "far away"
        return EffectBound(value, f"{lens}: the nearest is {where}")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return a summary in which the fixed part is done."""
        return replace(summary, superseded_effects=summary.superseded_effects | {Defocus.name})

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the blurred picture."""
        assert context.range_m is not None, "depths were not asked for"
        law = circle_of_confusion_map(self.aperture, camera)
        range_m = context.range_m.astype(np.float64)
        row = table_row(law.diameter_px(range_m)).astype(image.dtype)
        table = _kernel_table(self, camera)
        reach = table.half_width_up_to_row(float(row.max()))
        whole = interior_mask(camera)
        return convolve_symmetric_within(
            image, whole, reach, lambda rows: table.interpolate(row[rows], reach)
        )

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return each pixel's law, and the kernels' table."""
        return {
            "law": _circle_of_confusion_texture(self, camera),
            "weights": _kernel_table(self, camera).to_texture(),
            "centre_px": float32_array(*camera.centre_px),
            "whole_px": float32_array(interior_radius_px(camera)),
        }


def max_diameter_change_px(circle: CircleOfConfusion, min_distance_m: Floats) -> Floats:
    """Return the largest change of a disc between infinity and the nearest distance.

    What is behind the focus first shrinks, at most to a point, and then grows.
    """
    added = circle.near_term_px(min_distance_m)
    behind = np.maximum(-circle.infinity_diameter_px, 0.0)
    shrunk = np.minimum(added, behind)
    grown = circle.diameter_px(min_distance_m) - np.abs(circle.infinity_diameter_px)
    change: Floats = np.maximum(shrunk, grown)
    return change


def _kernel_table(effect: DefocusByDepth, camera: OmniCamera) -> DiscKernelTable:
    """Return the kernels of all things outside the mirror, however near."""
    return disc_kernel_table(max_diameter_px(effect.aperture, camera))


@lru_cache(maxsize=4)
def _circle_of_confusion_texture(
    effect: DefocusByDepth, camera: OmniCamera
) -> npt.NDArray[np.float32]:
    """Return the (h, w, 4) law: fixed_px, near_px, power_per_m, offset."""
    law = circle_of_confusion_map(effect.aperture, camera)
    parts = (law.infinity_diameter_px, law.near_px, law.power_per_m, law.offset)
    stacked: npt.NDArray[np.float32] = np.stack(parts, axis=-1).astype(np.float32)
    return stacked


def _create_effect(
    f_number: float, pixel_pitch_m: float, focus_distance_m: float
) -> DefocusByDepth:
    return DefocusByDepth(Aperture(f_number, pixel_pitch_m, focus_distance_m))


EFFECT_TYPE = EffectType("DefocusByDepth", _create_effect, APERTURE_PARAMETERS)
