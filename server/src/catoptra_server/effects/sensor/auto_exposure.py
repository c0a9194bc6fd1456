"""Auto-exposure: a gain brings the mean luminance of the omnidirectional image to a target.

gain = clip(target / mean, min_gain, max_gain), with the mean luminance (Rec. 709) of all pixels
that see the mirror, in linear radiance: one gain for the whole image, so no cube face is brighter
than its neighbour. The result is the state at which a control loop settles, not the loop: a frame
depends on no frame before, so equal camera states give equal bytes in every request. Domain: a
black image has max_gain. The default target is the 18 % of a photographer's grey card. Criterion:
the change of the grey that changes most, over all gains that the scene's radiance allows. Changes
by earlier effects count by the gain that a sample of the frame's light gives, with a reserve; those
by factors of light (reflectance, vignetting, exposure) by the gains with the factor and without.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy.typing as npt

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    CaptureContext,
    EffectBound,
    EffectParameter,
    EffectType,
    Gains,
    ImageEffect,
    Real,
    SceneSummary,
    Threshold,
)
from catoptra_server.effects.kernels.grey_levels import max_change_by_gain, mean_luminance


@dataclass(frozen=True, slots=True)
class AutoExposure:
    """Target and limits of the exposure control."""

    target_luminance: float
    """Mean luminance of the exposed image."""
    min_gain: float
    """Smallest gain of shutter and amplifier."""
    max_gain: float
    """Largest gain of shutter and amplifier."""

    name: ClassVar[str] = "AutoExposure"
    changes_scene: ClassVar[bool] = False
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    def gain(self, mean_luminance: float) -> float:
        """Gain of an image with this mean luminance."""
        gain = self.target_luminance / mean_luminance if mean_luminance > 0.0 else self.max_gain
        return min(max(gain, self.min_gain), self.max_gain)

    @property
    def gains(self) -> Gains:
        """The limits of the control."""
        return self.min_gain, self.max_gain

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Change of the grey that changes most, by the smallest or the largest gain."""
        # The mean lies between 0 and the maximum, and the change grows with the distance of the
        # gain from 1 on either side: both ends decide.
        gains = (self.gain(summary.max_radiance), self.max_gain)
        value = max(max_change_by_gain(gain, summary.picture_radiance) for gain in gains)
        return EffectBound(value, f"gains from {gains[0]:.3g} to {gains[1]:.3g} are possible")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of the image with the largest gain."""
        return replace(summary, max_radiance=self.max_gain * summary.max_radiance)

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Multiply the image by the gain of its mean luminance."""
        return image * image.dtype.type(self.gain(mean_luminance(image, camera)))


_RESERVE = 1.5
"""Between the gain of a sample of the light and that of the whole image: effects before may take a
quarter of the light, those left out less than 1 % of the mean, and samples miss a twentieth."""


def expect_gain(
    thresholds: Mapping[str, Threshold], effects: tuple[ImageEffect, ...], mean_luminance: float
) -> Mapping[str, Threshold]:
    """Thresholds by the gain that a frame will have, where an automatic exposure is among effects.

    Args:
        thresholds: Thresholds for any gain within the control's limits.
        effects: Image effects of the frame.
        mean_luminance: Of a sample of the light that reaches the first of them.
    """
    if mean_luminance <= 0.0:
        return thresholds
    control = next(one for one in effects if isinstance(one, AutoExposure))
    position = effects.index(control)
    for one in effects[:position]:
        if one.gains[0] == one.gains[1]:
            mean_luminance *= one.gains[0]
    gain = control.gain(mean_luminance)
    least = max(gain / _RESERVE, control.min_gain) / control.min_gain
    largest = min(_RESERVE * gain, control.max_gain) / control.max_gain
    later = {one.name for one in effects[position:]}
    return {
        name: one if name in later else one.narrow(least, largest)
        for name, one in thresholds.items()
    }


EFFECT_TYPE = EffectType(
    "AutoExposure",
    AutoExposure,
    (
        EffectParameter("AutoExposureTarget", "target_luminance", 0.18, 1e-4, 1.0),
        EffectParameter("AutoExposureMinGain", "min_gain", 0.1, 1e-4, 1.0),
        EffectParameter("AutoExposureMaxGain", "max_gain", 10.0, 1.0, 1e4),
    ),
)
