"""Response: what leaves the camera of each light: a shoulder towards white, or a measured curve.

Shoulder: light up to the knee k is left as it is. Above, with x = (L - k) / (1 - k) and
w = (W - k) / (1 - k), L' = k + (1 - k) x (1 + x / w^2) / (1 + x): it meets the line without a bend
and reaches white at the light W; what is brighter is white. Source: Reinhard et al. 2002,
"Photographic Tone Reproduction for Digital Images", Eq. 4, of what is above the knee. Domain:
0 <= k < 1 < W. Curve: grey levels of the picture by light, with lines of light between, from black
to the last row; `bt709` is that of Rec. ITU-R BT.709-6, item 1.2. Without the effect the response
is that of a measuring camera: light is cut at 1.

A curve is one table over L / (1 + L), with lines between its entries: 0.6 ms of a frame of 640 px,
the shoulder's formula 0.2. It bends what the sensor lets through: noise and converters cut light at
the full well before.
Earlier effects' bounds take the response for a gain up to G: no two lights differ behind it by more
than `contrast` times the levels that they have with one gain up to G that leaves the larger one
below white. Of the shoulder, concave through 0 and nowhere steeper than 1, both are 1; of a curve
they are found on 1024 lights, and thresholds are divided by the second. Criterion: the change of
the grey that changes most.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import exp, power
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    AVERAGING,
    CaptureContext,
    EffectBound,
    EffectParameter,
    EffectType,
    Gains,
    ParameterFault,
    Real,
    SceneSummary,
)
from catoptra_server.world.world_description import linear_from_srgb, srgb_from_linear

_NUM_STEPS = 1024
NUM_INTERVALS = 4096
"""Of the table."""
_MAX_LADDER, _MAX_CONTRAST = 40, 4.0
Curve = tuple[tuple[float, float], ...]
"""Light and grey level of the picture, row by row."""


def _make_bt709() -> Curve:
    light = np.linspace(0.0, 1.0, 257)
    grey = np.where(light < 0.018, 4.5 * light, 1.099 * power(light, 0.45) - 0.099)
    return tuple(zip(light.tolist(), (255.0 * grey).tolist(), strict=True))


@dataclass(frozen=True, slots=True)
class Response:
    """Curve with a shoulder, or of rows."""

    knee: float
    """Light from which the shoulder bends."""
    white: float
    """Light that the shoulder shows as white."""
    curve: Curve = ()
    """Rows in place of the shoulder."""

    name: ClassVar[str] = "Response"
    changes_scene: ClassVar[bool] = False
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    @property
    def gains(self) -> Gains:
        """As at the head of this module."""
        return (0.0, _find_steepness(self)[0]) if self.curve else AVERAGING

    @property
    def contrast(self) -> float:
        """Factor of changes of the picture over those by `gains`."""
        return _find_steepness(self)[1] if self.curve else 1.0

    @property
    def numbers(self) -> tuple[float, float, float]:
        """Knee, 1 less the knee, and 1 / w^2."""
        above = 1.0 - self.knee
        return self.knee, above, (above / (self.white - self.knee)) ** 2

    @property
    def table(self) -> npt.NDArray[np.float32]:
        """(NUM_INTERVALS + 1,) light that a curve shows, by L / (1 + L); read-only."""
        return _make_table(self)

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Change of the grey that changes most."""
        brightest = min(summary.max_radiance, 1.0)
        reason = f"the curve bends at {self.knee:.3g} and is white at {self.white:.3g}"
        if self.curve:
            last, grey = self.curve[-1]
            reason = f"a curve of {len(self.curve)} rows, up to {grey:.3g} of light {last:.3g}"
        elif brightest <= self.knee:
            return EffectBound(0.0, f"no light reaches {self.knee:.3g}, where the curve bends")
        # Between two steps the change is below that from one's curve to the other's light.
        # Finer in the dark, where the sRGB curve is steep.
        steps = np.square(np.arange(_NUM_STEPS + 1) / _NUM_STEPS)
        least = 0.0 if self.curve else self.knee
        light = least + (brightest - least) * steps
        plain, shown = srgb_from_linear(light), srgb_from_linear(self._bend(light))
        changes = plain[1:] - shown[:-1], shown[1:] - plain[:-1]
        return EffectBound(255.0 * float(np.max(changes)), reason)

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
        if self.curve:
            return self._bend_by_curve(light)
        knee, above, inverse, one = (light.dtype.type(number) for number in (*self.numbers, 1.0))
        x = np.maximum(light - knee, light.dtype.type(0.0)) / above
        shoulder = knee + above * (x * (one + x * inverse) / (one + x))
        return np.where(light > knee, np.minimum(shoulder, one), light)

    def _bend_by_curve(self, light: npt.NDArray[Real]) -> npt.NDArray[Real]:
        # Twin: change_curve in src/image_points.c. Light below 0 is noise.
        lit = np.maximum(light, light.dtype.type(0.0))
        place = lit / (light.dtype.type(1.0) + lit) * light.dtype.type(NUM_INTERVALS)
        left = np.minimum(place.astype(np.intp), NUM_INTERVALS - 1)
        low, high = (self.table[left + step].astype(light.dtype) for step in (0, 1))
        bent = low + (place - left.astype(light.dtype)) * (high - low)
        return np.where(light > light.dtype.type(0.0), bent, light)


@lru_cache(maxsize=16)
def _make_table(response: Response) -> npt.NDArray[np.float32]:
    share = np.arange(NUM_INTERVALS + 1) / NUM_INTERVALS
    lights, greys = np.array(response.curve).T
    shown, light = linear_from_srgb(greys / 255.0), share / np.maximum(1.0 - share, 1e-9)
    row = np.clip(np.searchsorted(lights, light, side="right") - 1, 0, len(lights) - 2)
    part = np.clip((light - lights[row]) / (lights[row + 1] - lights[row]), 0.0, 1.0)
    table = np.asarray(shown[row] + part * (shown[row + 1] - shown[row]), dtype=np.float32)
    table.setflags(write=False)
    return table


@lru_cache(maxsize=16)
def _find_steepness(response: Response) -> tuple[float, float]:
    """Gain and contrast of a curve, as at the head of this module."""
    light = max(response.curve[-1][0], 1.0) * exp(np.linspace(-11.5, 0.0, 1024))
    levels = srgb_from_linear(response._bend(light))
    low, high = np.triu_indices(len(light), 1)
    # Levels of each ratio of two lights, the larger one at white.
    ratios = srgb_from_linear(light / light[-1])[len(light) - 1 - (high - low)]
    rise, steepest = levels[high] - levels[low], 1.0 - ratios
    gain = float((linear_from_srgb(levels) / light).max())
    least = float((rise / steepest).max())
    for _ in range(_MAX_LADDER):
        shown = srgb_from_linear(gain * light)
        below = shown[high] - shown[low]
        contrast = float((rise / np.where(gain * light[high] < 1.0, below, steepest)).max())
        if contrast <= max(1.02 * least, 1.0):
            break
        gain *= 1.25
    # A hundredth for what lies between the lights.
    return 1.001 * gain, max(1.01 * contrast, 1.0)


def _find_fault(response: Response) -> ParameterFault | None:
    """What a curve's rows have wrong."""
    if not response.curve:
        return None
    lights, greys = np.array(response.curve).T
    expected = ""
    if len(lights) < 2 or response.curve[0] != (0.0, 0.0) or greys[-1] == 0.0:
        expected = "two rows at least, the first of light 0 and grey 0, the last not black"
    elif (np.diff(greys) < 0.0).any() or greys[-1] > 255.0:
        row = int(np.argmax(np.append(np.diff(greys) < 0.0, True))) + 2
        expected = f"grey levels that never fall, up to 255; row {min(row, len(greys))} has another"
    elif _find_steepness(response)[1] > _MAX_CONTRAST:
        expected = f"a curve without steps, below {78 * _MAX_CONTRAST:.0f} levels a stop"
    return ParameterFault("ResponseCurve", expected) if expected else None


EFFECT_TYPE = EffectType(
    "Response",
    Response,
    (
        EffectParameter("ResponseKnee", "knee", 0.4, 0.0, 0.95),
        EffectParameter("ResponseWhite", "white", 4.0, 1.05, 1000.0),
    ),
    find_fault=_find_fault,
    curve_key="ResponseCurve",
    curves={"shoulder": (), "bt709": _make_bt709()},
)
