"""Auto-exposure: the mean of the whole omnidirectional picture is brought to a target.

gain = clip(target / mean, least, most), the mean of the luminance (Rec. 709) of all pixels that see
the mirror, in linear light: one value for all faces, so no face is brighter than its neighbour. It
is the end that a control loop settles at, not the loop: a frame depends on no frame before it, so
that the same exposure gives the same bytes for whoever asks. Domain: a black picture takes `most`.
The usual target is the 18 % of a photographer's grey card. Criterion: the change of the grey that
changes most over all gains that the scene's brightest light leaves possible.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera import OmniCamera, direction_from_pixel, pixel_centres
from catoptra_server.effects.capture import Capture
from catoptra_server.effects.effect import (
    GREY_LEVELS,
    Bound,
    Kind,
    Parameter,
    Real,
    Uniforms,
    floats,
)
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.effects.shared.grey_levels import change_by_gain

LUMINANCE = (0.2126, 0.7152, 0.0722)


@dataclass(frozen=True, slots=True)
class AutoExposure:
    """target: mean light wanted. least, most: the gains that shutter and amplifier allow."""

    target: float
    least: float
    most: float

    name: ClassVar[str] = "AutoExposure"
    unit: ClassVar[str] = GREY_LEVELS
    uses_range: ClassVar[bool] = False

    def gain(self, mean: float) -> float:
        """Return by how much a picture of this mean light is multiplied."""
        wished = self.target / mean if mean > 0.0 else self.most
        return min(max(wished, self.least), self.most)

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return the change of the grey that changes most, by the least or the most gain."""
        gains = (self.gain(summary.largest_radiance), self.most)
        value = max(change_by_gain(gain, summary.largest_radiance) for gain in gains)
        return Bound(value, f"gains from {gains[0]:.3g} to {gains[1]:.3g} are possible")

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of what is multiplied by the most."""
        return replace(summary, largest_radiance=self.most * summary.largest_radiance)

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the multiplied picture."""
        return light * light.dtype.type(self.gain(mean_of(light, camera)))

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return the gain."""
        return {"gain": floats(self.gain(mean_light()))}


def mean_of(light: npt.NDArray[Real], camera: OmniCamera) -> float:
    """Return the mean luminance of the pixels that see the mirror."""
    colours = light.sum(axis=(0, 1), dtype=np.float64)
    return float(colours @ LUMINANCE) / max(mirror_pixels(camera), 1)


@lru_cache(maxsize=16)
def mirror_pixels(camera: OmniCamera) -> int:
    """Return how many pixels see the mirror in their middle; all others are black."""
    return int(direction_from_pixel(camera, pixel_centres(camera))[1].sum())


KIND = Kind(
    "AutoExposure",
    AutoExposure,
    (
        Parameter("AutoExposureTarget", "target", 0.18, 1e-4, 1.0),
        Parameter("AutoExposureLeast", "least", 0.1, 1e-4, 1.0),
        Parameter("AutoExposureMost", "most", 10.0, 1.0, 1e4),
    ),
)
