"""Exposure: how long the shutter is open, against the time in which white fills a pixel's well.

Electrons grow with the time: L' = L T / T_white. Domain: T, T_white > 0; linear up to the full
well, where light is clipped. Source: EMVA Standard 1288, the linear camera model. Criterion: the
change of the grey that changes most.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy.typing as npt

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import (
    GREY_LEVELS,
    EffectBound,
    EffectParameter,
    EffectType,
    Real,
    Uniforms,
    float32_array,
)
from catoptra_server.effects.kernels.grey_levels import max_change_by_gain
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class Exposure:
    """time_s: the shutter's. white_exposure_s: the one at which radiance 1 fills the well."""

    exposure_s: float
    white_exposure_s: float

    name: ClassVar[str] = "Exposure"
    unit: ClassVar[str] = GREY_LEVELS
    needs_range: ClassVar[bool] = False

    @property
    def gain(self) -> float:
        """Return by how much light is multiplied."""
        return self.exposure_s / self.white_exposure_s

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return the change of the grey that changes most."""
        value = max_change_by_gain(self.gain, summary.max_radiance)
        return EffectBound(
            value, f"the shutter is open {self.gain:.3g} times as long as white needs"
        )

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of what is multiplied."""
        return replace(summary, max_radiance=self.gain * summary.max_radiance)

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the multiplied picture."""
        return image * image.dtype.type(self.gain)

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return the gain."""
        return {"gain": float32_array(self.gain)}


EFFECT_TYPE = EffectType(
    "Exposure",
    Exposure,
    (
        EffectParameter("ExposureTime", "exposure_s", 1.0 / 60.0, 1e-6, 60.0),
        EffectParameter("WhiteExposureTime", "white_exposure_s", 1.0 / 60.0, 1e-6, 60.0),
    ),
)
