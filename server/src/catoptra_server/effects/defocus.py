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

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.capture import Capture
from catoptra_server.effects.effect import PIXELS, Bound, Kind, Parameter, Real, Uniforms, floats
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.effects.shared.disc_kernel import DiscTable, disc_table, row_of
from catoptra_server.effects.shared.lens_blur import (
    Aperture,
    blur_law,
    nearest_at,
    pixel_law,
    radii_px,
    telling,
    whole_pixels,
    whole_radius_px,
)
from catoptra_server.effects.shared.symmetric_kernels import gathered_within


@dataclass(frozen=True, slots=True)
class Defocus:
    """The lens and what it is focused at."""

    aperture: Aperture

    name: ClassVar[str] = "Defocus"
    unit: ClassVar[str] = PIXELS
    uses_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return the largest disc of what is in view."""
        radius = radii_px(camera)
        law = blur_law(self.aperture, camera, radius)
        near = law.diameter_px(nearest_at(summary, camera, radius))
        value = float(np.maximum(np.abs(law.fixed_px), near).max())
        far = float(np.abs(law.fixed_px).max())
        lens = telling(self.aperture, camera)
        return Bound(value, f"{lens}: discs of up to {far:.2g} px from afar")

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: no pixel gets brighter than the brightest around it."""
        return summary

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the blurred picture."""
        weights = _weights(self, camera, light.dtype)
        reach = _table(self, camera).reach_px
        return gathered_within(light, whole_pixels(camera), reach, lambda rows: weights[:, rows])

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return each pixel's row of the kernels' table, and the table."""
        return {
            "row": _row_map(self, camera),
            "weights": _table(self, camera).texture(),
            "centre_px": floats(*camera.centre_px),
            "whole_px": floats(whole_radius_px(camera)),
        }


def _table(effect: Defocus, camera: OmniCamera) -> DiscTable:
    return disc_table(float(np.abs(pixel_law(effect.aperture, camera).fixed_px).max()))


@lru_cache(maxsize=2)
def _weights(effect: Defocus, camera: OmniCamera, dtype: np.dtype[Real]) -> npt.NDArray[Real]:
    """Return the (pairs, h, w) weights of every pixel."""
    table = _table(effect, camera)
    row = row_of(pixel_law(effect.aperture, camera).fixed_px)
    weights: npt.NDArray[Real] = table.mixed(row, table.reach_px).astype(dtype)
    weights.setflags(write=False)
    return weights


@lru_cache(maxsize=4)
def _row_map(effect: Defocus, camera: OmniCamera) -> npt.NDArray[np.float32]:
    """Return the (h, w, 1) rows, with their fractions."""
    row: npt.NDArray[np.float32] = row_of(pixel_law(effect.aperture, camera).fixed_px).astype(
        np.float32
    )
    return row[..., None]


# Keys that `Diffraction` shares.
F_NUMBER = Parameter("FNumber", "f_number", 4.0, 0.7, 64.0)
PIXEL_PITCH = Parameter("PixelPitch", "pixel_pitch_m", 7.4e-6, 1e-7, 1e-3)
# 0: where the largest disc of what is far away is least.
FOCUS_DISTANCE = Parameter("FocusDistance", "focus_m", 0.0, 0.0, 1000.0)
APERTURE_PARAMETERS = (F_NUMBER, PIXEL_PITCH, FOCUS_DISTANCE)


def _made(f_number: float, pixel_pitch_m: float, focus_m: float) -> Defocus:
    return Defocus(Aperture(f_number, pixel_pitch_m, focus_m))


KIND = Kind("Defocus", _made, APERTURE_PARAMETERS)
