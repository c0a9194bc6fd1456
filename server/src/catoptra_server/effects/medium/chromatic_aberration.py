"""Chromatic aberration: the capture camera's lens images red and blue larger or smaller than green.

Lateral colour of the first order: L'_c(p) = L_c(o + (p - o) / m_c), o the lens's axis in the
picture, m_c the magnification of red or blue over that of green; between pixels bilinear, in linear
light. Axial colour, a focus of its own for each colour, is left out. Domain: magnifications near 1;
beyond the picture's border its last pixels go on. Criterion: the largest |p - q| of what the
picture shows of the mirror.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.image_scale import visible_radii_px
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import (
    PIXELS,
    EffectBound,
    EffectParameter,
    EffectType,
    Real,
    Uniforms,
)
from catoptra_server.effects.scene_summary import SceneSummary

_RED, _BLUE = 0, 2


@dataclass(frozen=True, slots=True)
class ChromaticAberration:
    """red, blue: their magnification over that of green."""

    red_magnification: float = 1.0
    blue_magnification: float = 1.0

    name: ClassVar[str] = "ChromaticAberration"
    unit: ClassVar[str] = PIXELS
    needs_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return how far the colour that is farther off moves at the farthest place."""
        off = max(
            abs(m - 1.0) / min(m, 1.0) for m in (self.red_magnification, self.blue_magnification)
        )
        radius_px = visible_radii_px(camera)[1]
        return EffectBound(off * radius_px, f"the rim's colours differ in size by {off:.2%}")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: nothing becomes brighter."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the picture with its red and its blue resized."""
        coloured = image.copy()
        across, down = channel_offsets_px(self, camera)
        for index, colour in enumerate((_RED, _BLUE)):
            wide = _interpolate_along_axis(image[..., colour], across[0, :, index], axis=1)
            coloured[..., colour] = _interpolate_along_axis(wide, down[:, 0, index], axis=0)
        return coloured

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return how far aside columns and rows are read."""
        across, down = channel_offsets_px(self, camera)
        return {"across": across, "down": down}


@lru_cache(maxsize=4)
def channel_offsets_px(
    effect: ChromaticAberration, camera: OmniCamera
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return how far aside red and blue are read: (1, w, 2) of columns, (h, 1, 2) of rows."""
    shrunk = np.array(
        [(1.0 - m) / m for m in (effect.red_magnification, effect.blue_magnification)]
    )
    u = np.arange(camera.width_px) + 0.5 - camera.centre_px[0]
    v = np.arange(camera.height_px) + 0.5 - camera.centre_px[1]
    across = (u[None, :, None] * shrunk).astype(np.float32)
    down = (v[:, None, None] * shrunk).astype(np.float32)
    across.setflags(write=False)
    down.setflags(write=False)
    return across, down


def _interpolate_along_axis(
    plane: npt.NDArray[Real], offset_px: npt.NDArray[np.float32], *, axis: int
) -> npt.NDArray[Real]:
    """Return the (h, w) plane read so far aside of its columns (axis 1) or rows (axis 0)."""
    whole = np.floor(offset_px)
    share = np.expand_dims((offset_px - whole).astype(plane.dtype), 1 - axis)
    low = np.arange(len(offset_px)) + whole.astype(np.intp)
    last = len(offset_px) - 1
    one = plane.take(np.clip(low, 0, last), axis=axis)
    other = plane.take(np.clip(low + 1, 0, last), axis=axis)
    mixed: npt.NDArray[Real] = one + share * (other - one)
    return mixed


EFFECT_TYPE = EffectType(
    "ChromaticAberration",
    ChromaticAberration,
    (
        EffectParameter("RedMagnification", "red_magnification", 1.0, 0.95, 1.05),
        EffectParameter("BlueMagnification", "blue_magnification", 1.0, 0.95, 1.05),
    ),
)
