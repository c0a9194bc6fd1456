"""Exposure: the time for which the shutter is open, relative to the time that saturates white.

Electrons grow with the time: L' = L T / T_white. Domain: T, T_white > 0; linear up to the full
well, where the image is clipped. Source: EMVA Standard 1288, the linear camera model. Criterion:
the change of the grey that changes most. Motion during the exposure is the effect MotionBlur.
"""

from __future__ import annotations

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
    Real,
    SceneSummary,
)
from catoptra_server.effects.kernels.grey_levels import max_change_by_gain


@dataclass(frozen=True, slots=True)
class Exposure:
    """Exposure time of a sensor with a given sensitivity."""

    exposure_s: float
    """Time for which the shutter is open."""
    white_exposure_s: float
    """Time in which radiance 1 fills a pixel's well."""

    name: ClassVar[str] = "Exposure"
    changes_scene: ClassVar[bool] = False
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    @property
    def gain(self) -> float:
        """Factor of the linear image."""
        return self.exposure_s / self.white_exposure_s

    @property
    def gains(self) -> Gains:
        """The one gain of all pixels."""
        return self.gain, self.gain

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Change of the grey that changes most."""
        value = max_change_by_gain(self.gain, summary.picture_radiance)
        return EffectBound(value, f"the exposure is {self.gain:.3g} times that of white")

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of the scaled image."""
        # Not clipped at 1: blooming needs the charge above the full well.
        return replace(summary, max_radiance=self.gain * summary.max_radiance)

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Multiply the image by the gain."""
        # The gain is rounded to the image's type first, as the kernel's number is.
        return image * image.dtype.type(self.gain)


EFFECT_TYPE = EffectType(
    "Exposure",
    Exposure,
    (
        # The key of MotionBlur, too: one shutter blurs and exposes.
        EffectParameter("ExposureTime", "exposure_s", 1.0 / 60.0, 1e-6, 60.0),
        EffectParameter("WhiteExposureTime", "white_exposure_s", 1.0 / 60.0, 1e-6, 60.0),
    ),
)
