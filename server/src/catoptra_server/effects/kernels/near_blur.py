"""Blur, by the camera's lens, of what is fixed near the mirror: one disc for each image radius."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.kernels.convolution import (
    DiscKernelTable,
    convolve_symmetric,
    disc_kernel_table,
    table_row,
)
from catoptra_server.effects.kernels.lens_blur import (
    Aperture,
    circle_of_confusion,
    map_of_radius,
)


@dataclass(frozen=True, slots=True, eq=False)
class NearBlur:
    """Discs of one camera."""

    kernel_table: DiscKernelTable
    table_row: Floats
    """Fractional row of the kernel table for each pixel, (h, w)."""

    @property
    def max_weight(self) -> float:
        """Largest weight in the kernel of any pixel."""
        # The narrowest kernel has the largest weights.
        narrowest = self.table_row.min(keepdims=True)
        weights = self.kernel_table.interpolate(narrowest, self.kernel_table.half_width_px)
        return float(weights.max())

    def blur(self, image: Floats) -> Floats:
        """Blur a (h, w) image."""
        table, row = self.kernel_table, self.table_row
        return convolve_symmetric(
            image[..., None],
            table.half_width_px,
            lambda rows: table.interpolate(row[rows], table.half_width_px),
        )[..., 0]


def make_near_blur(
    aperture: Aperture, camera: OmniCamera, range_m: Callable[[Floats], Floats]
) -> NearBlur:
    """Blur of objects whose range from the viewpoint is a function of the image radius in px."""

    def diameter_px(radius_px: Floats) -> Floats:
        within_px = np.minimum(radius_px, camera.rim_radius_px)
        return circle_of_confusion(aperture, camera, radius_px).diameter_px(range_m(within_px))

    diameters_px = map_of_radius(camera, diameter_px)
    return NearBlur(disc_kernel_table(float(diameters_px.max())), table_row(diameters_px))
