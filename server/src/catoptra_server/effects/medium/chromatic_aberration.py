"""Chromatic aberration: a camera's lens magnifies red and blue differently from green.

Lateral colour of the first order: L'_c(p) = L_c(o + (p - o) / m_c), o the lens's axis in the image,
m_c the magnification of red or blue over green's; bilinear between pixels, in linear
radiance. Axial colour, one focus for each colour, is left out. Domain: magnifications near 1;
outside the image the border pixel is repeated. Criterion: the largest |p - q| in view times the
contrast of black and the brightest.
"""

from __future__ import annotations

from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.image_plane import visible_radii_px
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
from catoptra_server.effects.kernels.grey_levels import max_change_by_shift

# Green is the reference: its image keeps every bit.
_RED, _BLUE = 0, 2


@dataclass(frozen=True, slots=True)
class ChromaticAberration:
    """Magnification of red and blue over green's."""

    red_magnification: float = 1.0
    blue_magnification: float = 1.0

    name: ClassVar[str] = "ChromaticAberration"
    changes_scene: ClassVar[bool] = False
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Bound the change by the displacement of red or blue at the outermost visible radius."""
        # |p - q| = r |m - 1| / m at the output pixel, r |m - 1| at the input pixel: the larger.
        relative = max(
            abs(m - 1.0) / min(m, 1.0) for m in (self.red_magnification, self.blue_magnification)
        )
        displacement_px = relative * visible_radii_px(camera)[1]
        return EffectBound(
            max_change_by_shift(displacement_px, summary.picture_radiance),
            f"the rim's colours differ in size by {relative:.2%}",
            displacement_px,
        )

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: interpolation makes no pixel brighter."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Resize red and blue about the lens's axis."""
        result = image.copy()
        columns_px, rows_px = channel_offsets_px(self, camera)
        # Separable: a magnification moves columns and rows independently.
        for index, channel in enumerate((_RED, _BLUE)):
            wide = _interpolate_along_axis(image[..., channel], columns_px[0, :, index], axis=1)
            result[..., channel] = _interpolate_along_axis(wide, rows_px[:, 0, index], axis=0)
        return result


@lru_cache(maxsize=4)
def channel_offsets_px(
    effect: ChromaticAberration, camera: RadialCamera
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Offsets to the pixels that red and blue are read from.

    Returns:
        (1, w, 2) offsets of columns and (h, 1, 2) of rows, px; last axis: red, blue.
    """
    # (p - o) / m - (p - o), with the quotient taken first: 1 / m - 1 would lose digits near m = 1.
    magnifications = (effect.red_magnification, effect.blue_magnification)
    relative = np.array([(1.0 - m) / m for m in magnifications])
    u = np.arange(camera.width_px) + 0.5 - camera.centre_px[0]
    v = np.arange(camera.height_px) + 0.5 - camera.centre_px[1]
    columns_px = (u[None, :, None] * relative).astype(np.float32)
    rows_px = (v[:, None, None] * relative).astype(np.float32)
    columns_px.setflags(write=False)
    rows_px.setflags(write=False)
    return columns_px, rows_px


def _interpolate_along_axis(
    plane: npt.NDArray[Real], offset_px: npt.NDArray[np.float32], *, axis: int
) -> npt.NDArray[Real]:
    """Sample a (h, w) plane at offsets from its columns (axis 1) or rows (axis 0)."""
    whole = np.floor(offset_px)
    fraction = np.expand_dims((offset_px - whole).astype(plane.dtype), 1 - axis)
    low = np.arange(len(offset_px)) + whole.astype(np.intp)
    last = len(offset_px) - 1
    one = plane.take(np.clip(low, 0, last), axis=axis)
    other = plane.take(np.clip(low + 1, 0, last), axis=axis)
    mixed: npt.NDArray[Real] = one + fraction * (other - one)
    return mixed


EFFECT_TYPE = EffectType(
    "ChromaticAberration",
    ChromaticAberration,
    (
        EffectParameter("RedMagnification", "red_magnification", 1.0, 0.95, 1.05),
        EffectParameter("BlueMagnification", "blue_magnification", 1.0, 0.95, 1.05),
    ),
)
