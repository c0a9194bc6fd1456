"""White balance: red and blue are amplified relative to green, after the sensor.

L' = g min(L, 1), g = (red, 1, blue): a full well stays full, so clipped white takes on the gains'
colour as in real cameras. Source: von Kries's adaptation, a diagonal matrix in the camera's own
colours. Domain: gains > 0. Criterion: the change of the grey that changes most.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    CaptureContext,
    EffectBound,
    EffectParameter,
    EffectType,
    Gains,
    Real,
    SceneSummary,
)
from catoptra_server.effects.kernels.grey_levels import max_change_by_gain


@dataclass(frozen=True, slots=True)
class WhiteBalance:
    """Gains of red and blue relative to green."""

    red_gain: float
    blue_gain: float

    name: ClassVar[str] = "WhiteBalance"
    changes_scene: ClassVar[bool] = False
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    @property
    def gains(self) -> Gains:
        """Of the three colours."""
        gains = (self.red_gain, 1.0, self.blue_gain)
        return min(gains), max(gains)

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Change of the grey that changes most."""
        gains = (self.red_gain, self.blue_gain)
        value = max(max_change_by_gain(gain, summary.picture_radiance) for gain in gains)
        return EffectBound(value, f"red times {self.red_gain:.3g}, blue times {self.blue_gain:.3g}")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of the colour with the largest gain."""
        # Green's gain of 1 counts: with both others below 1 green is the brightest.
        max_gain = max(self.red_gain, 1.0, self.blue_gain)
        return replace(summary, max_radiance=min(summary.max_radiance, 1.0) * max_gain)

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Clip the image at the full well and amplify red and blue."""
        # Clipped before the gains: amplified afterwards a full well keeps the three colours' ratio.
        gains = np.array((self.red_gain, 1.0, self.blue_gain), dtype=image.dtype)
        return np.minimum(image, image.dtype.type(1.0)) * gains


EFFECT_TYPE = EffectType(
    "WhiteBalance",
    WhiteBalance,
    (
        EffectParameter("RedGain", "red_gain", 1.0, 0.05, 20.0),
        EffectParameter("BlueGain", "blue_gain", 1.0, 0.05, 20.0),
    ),
)
