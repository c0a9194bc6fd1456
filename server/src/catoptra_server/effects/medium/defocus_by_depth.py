"""Defocus by each pixel's range: for objects so near that their disc differs from infinity's.

Every pixel is the mean of a uniform disc around it, with the diameter of `lens_blur`'s circle of
confusion at the range of the pixel's centre. The effect includes all of `Defocus` and supersedes
that effect: an image blurred by another disc before cannot be made sharp again. Robot files that
name both leave the choice to the two criteria. Domain: as of `Defocus`. Criterion: the largest
difference between the kernels of the nearest object in view and of infinity, times the contrast of
black and the brightest; where `Defocus` is not to be drawn, that effect's criterion.
"""

from __future__ import annotations

import math
from dataclasses import replace
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
    CircleOfConfusion,
    circle_of_confusion,
    circle_of_confusion_map,
    describe_lens,
    interior_mask,
    max_diameter_px,
    min_distance_at_radius,
    sample_radii_px,
)
from catoptra_server.effects.medium.defocus import APERTURE_PARAMETERS, Defocus


@dataclass(frozen=True, slots=True)
class DefocusByDepth:
    """Defocus of a lens by image radius and range."""

    aperture: Aperture

    name: ClassVar[str] = "DefocusByDepth"
    changes_scene: ClassVar[bool] = False
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = DISTANCE_FIELDS | {"max_radiance", "has_defocus"}
    needs_range: ClassVar[bool] = True

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Bound the change against `Defocus`, by the disc of anything in view and of infinity."""
        if not summary.has_defocus:  # all of the blur is this effect's
            return Defocus(self.aperture).bound(summary, camera)
        radius_px = sample_radii_px(camera)
        circle = circle_of_confusion(self.aperture, camera, radius_px)
        min_distance_m = min_distance_at_radius(summary, camera, radius_px)
        # Relative to infinity's disc, not absolute: Defocus already does that part without ranges.
        displacement_px = float(circle.max_diameter_change_px(min_distance_m).max())
        exchange = _max_exchange(circle, min_distance_m)
        nearest_m = min(summary.visible_min_distances_m)
        lens = describe_lens(self.aperture, camera)
        distance = f"{nearest_m:.2g} m away" if math.isfinite(nearest_m) else "far away"
        return EffectBound(
            max_change_by_exchange(exchange, summary.picture_radiance),
            f"{lens}: the nearest object is {distance}",
            displacement_px,
        )

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary in which `Defocus` is included."""
        included = summary.included_effects | {(Defocus.name, self.name)}
        return replace(summary, included_effects=included)

    def kernel_table(self, camera: RadialCamera) -> DiscKernelTable:
        """Kernels of all points outside the mirror, however near."""
        # Not of the nearest object of one frame: each frame would have another table.
        return disc_kernel_table(max_diameter_px(self.aperture, camera))

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Blur the image by each pixel's range."""
        assert context.range_m is not None, "defocus by depth needs ranges"
        circle = circle_of_confusion_map(self.aperture, camera)
        # Diameters in float64 from float32 ranges: near the focus two terms of opposite sign
        # cancel.
        row = table_row(circle.diameter_px(context.range_m.astype(np.float64))).astype(image.dtype)
        table = self.kernel_table(camera)
        # The table reaches to discs of points on the mirror; most frames need a fraction of it.
        half_width_px = table.half_width_up_to_row(float(row.max()))
        return convolve_symmetric_within(
            image,
            interior_mask(camera),
            half_width_px,
            lambda rows: table.interpolate(row[rows], half_width_px),
        )


def _max_exchange(circle: CircleOfConfusion, min_distance_m: Floats) -> float:
    """Largest fraction of light that a disc nearer than infinity takes from other pixels than
    infinity's disc does.

    Args:
        circle: Circle of confusion at (n,) image radii.
        min_distance_m: (n,) distance of the nearest object at each.
    """
    far_px = np.abs(circle.infinity_diameter_px)
    near_px = circle.diameter_px(min_distance_m)
    # Behind the focus a disc may shrink to a point before it grows.
    crosses_focus = circle.near_term_px(min_distance_m) > -circle.infinity_diameter_px
    crosses_focus &= circle.infinity_diameter_px < 0.0
    smallest_px = np.where(crosses_focus, 0.0, np.minimum(far_px, near_px))
    table = disc_kernel_table(float(np.maximum(far_px, near_px).max()))
    return max(
        table.max_exchange(*pair)
        for others_px in (near_px, smallest_px)
        for pair in zip(far_px.tolist(), others_px.tolist(), strict=True)
    )


def _create_effect(
    f_number: float, pixel_pitch_m: float, focus_distance_m: float
) -> DefocusByDepth:
    return DefocusByDepth(Aperture(f_number, pixel_pitch_m, focus_distance_m))


EFFECT_TYPE = EffectType(
    "DefocusByDepth", _create_effect, APERTURE_PARAMETERS, needs_viewpoint=True
)
