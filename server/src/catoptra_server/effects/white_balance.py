"""White balance: red and blue are amplified against green, after the sensor.

L' = g min(L, 1), g = (red, 1, blue): a full well stays what it is, so that clipped white takes on
the gains' colour as it does in cameras. Source: von Kries's adaptation, a diagonal matrix in the
camera's own colours. Domain: gains > 0. Criterion: the change of the grey that changes most.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
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
class WhiteBalance:
    """red, blue: gains against green."""

    red: float
    blue: float

    name: ClassVar[str] = "WhiteBalance"
    unit: ClassVar[str] = GREY_LEVELS
    uses_range: ClassVar[bool] = False

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return the change of the grey that changes most."""
        value = max(change_by_gain(g, summary.largest_radiance) for g in (self.red, self.blue))
        return Bound(value, f"red times {self.red:.3g}, blue times {self.blue:.3g}")

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of the most amplified colour."""
        return replace(
            summary,
            largest_radiance=min(summary.largest_radiance, 1.0) * max(self.red, 1.0, self.blue),
        )

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the balanced picture."""
        gains = np.array((self.red, 1.0, self.blue), dtype=light.dtype)
        return np.minimum(light, light.dtype.type(1.0)) * gains

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return the gains."""
        return {"gains": floats(self.red, 1.0, self.blue)}


KIND = Kind(
    "WhiteBalance",
    WhiteBalance,
    (
        Parameter("RedGain", "red", 1.0, 0.05, 20.0),
        Parameter("BlueGain", "blue", 1.0, 0.05, 20.0),
    ),
)
