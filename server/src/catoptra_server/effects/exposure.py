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

from catoptra_protocol.optics.camera import OmniCamera
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


@dataclass(frozen=True, slots=True)
class Exposure:
    """time_s: the shutter's. white_time_s: the one at which radiance 1 fills the well."""

    time_s: float
    white_time_s: float

    name: ClassVar[str] = "Exposure"
    unit: ClassVar[str] = GREY_LEVELS
    uses_range: ClassVar[bool] = False

    @property
    def gain(self) -> float:
        """Return by how much light is multiplied."""
        return self.time_s / self.white_time_s

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return the change of the grey that changes most."""
        value = change_by_gain(self.gain, summary.largest_radiance)
        return Bound(value, f"the shutter is open {self.gain:.3g} times as long as white needs")

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of what is multiplied."""
        return replace(summary, largest_radiance=self.gain * summary.largest_radiance)

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the multiplied picture."""
        return light * light.dtype.type(self.gain)

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return the gain."""
        return {"gain": floats(self.gain)}


KIND = Kind(
    "Exposure",
    Exposure,
    (
        Parameter("ExposureTime", "time_s", 1.0 / 60.0, 1e-6, 60.0),
        Parameter("WhiteExposureTime", "white_time_s", 1.0 / 60.0, 1e-6, 60.0),
    ),
)
