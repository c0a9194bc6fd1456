"""Response: what leaves the camera of each light, with a shoulder towards white.

Light up to the knee k is left as it is. Above, with x = (L - k) / (1 - k) and
w = (W - k) / (1 - k), L' = k + (1 - k) x (1 + x / w^2) / (1 + x): it meets the line without a bend
and reaches white at the light W; what is brighter is white. Without the effect the response is that
of a measuring camera: light is cut at 1. Source: Reinhard et al. 2002, "Photographic Tone
Reproduction for Digital Images", Eq. 4, of what is above the knee. Domain: 0 <= k < 1 < W. The
curve is concave through 0 and nowhere steeper than 1, so that earlier effects' bounds take it for a
gain from 0 to 1. It bends what the sensor lets through: noise and converters cut light at the full
well before. Criterion: the change of the grey that changes most.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt

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
from catoptra_server.world.world_description import srgb_from_linear

_NUM_STEPS = 1024


@dataclass(frozen=True, slots=True)
class Response:
    """Curve with a shoulder."""

    knee: float
    """Light from which the curve bends."""
    white: float
    """Light that is shown as white."""

    name: ClassVar[str] = "Response"
    changes_scene: ClassVar[bool] = False
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False
    gains: ClassVar[Gains] = AVERAGING

    @property
    def numbers(self) -> tuple[float, float, float]:
        """Knee, 1 less the knee, and 1 / w^2."""
        above = 1.0 - self.knee
        return self.knee, above, (above / (self.white - self.knee)) ** 2

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Change of the grey that changes most."""
        brightest = min(summary.max_radiance, 1.0)
        reason = f"the curve bends at {self.knee:.3g} and is white at {self.white:.3g}"
        if brightest <= self.knee:
            return EffectBound(0.0, f"no light reaches {self.knee:.3g}, where the curve bends")
        # Between two steps the change is below that from the lower one's curve to the upper light.
        light = np.linspace(self.knee, brightest, _NUM_STEPS + 1)
        shown = srgb_from_linear(self._bend(light))
        change = 255.0 * float((srgb_from_linear(light)[1:] - shown[:-1]).max())
        return EffectBound(change, reason)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of the brightest light's response."""
        brightest = float(self._bend(np.array([summary.max_radiance]))[0])
        return replace(summary, max_radiance=brightest)

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Bend the light of each pixel and colour."""
        return self._bend(image)

    def _bend(self, light: npt.NDArray[Real]) -> npt.NDArray[Real]:
        knee, above, inverse, one = (light.dtype.type(number) for number in (*self.numbers, 1.0))
        x = np.maximum(light - knee, light.dtype.type(0.0)) / above
        shoulder = knee + above * (x * (one + x * inverse) / (one + x))
        return np.where(light > knee, np.minimum(shoulder, one), light)


EFFECT_TYPE = EffectType(
    "Response",
    Response,
    (
        EffectParameter("ResponseKnee", "knee", 0.4, 0.0, 0.95),
        EffectParameter("ResponseWhite", "white", 4.0, 1.05, 1000.0),
    ),
)
