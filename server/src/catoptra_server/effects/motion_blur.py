"""Motion blur: what moves through the picture while the shutter is open is spread along its way.

L'(p) = mean over tau in [-T/2, T/2] of L(q(tau)), q where what is at p at tau was in the sharp
picture (`image_ways`), in linear light, read by cubics. The exposure is centred on the pose. The
mean is that of at least two times, no more than 1.5 px apart, spread so that they have the
variance of the whole exposure. Beyond the rim nothing is known: there, and for pixels that the rim
goes through, a pixel keeps its own light.

Domain: twists that stay during the exposure; shadows and light stay with what they fall on. What
was hidden is made of what is beside it. Error: one sharp picture knows no more than its pixels do.
Criterion: how wide a point is spread at most, ring by ring: the exposure times speed over the
nearest range, and turns.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.capture import Capture
from catoptra_server.effects.cubic import with_differences
from catoptra_server.effects.effect import PIXELS, Bound, Kind, Parameter, Real, Uniforms
from catoptra_server.effects.image_motion import ImageMotion, Whole, motion_uniforms
from catoptra_server.effects.image_speed import largest_way
from catoptra_server.effects.image_ways import ImageWays
from catoptra_server.effects.moved_light import moved_light
from catoptra_server.effects.scene_summary import SceneSummary

# What spreads by less is left as it is: bytes stay the same where nothing moves.
STILL_PX = 0.1
_SPACING_PX = 1.5
_MOST_TIMES = 64
# So many pixels at once: their numbers stay in the processor's cache.
_CHUNK = 1 << 13


@dataclass(frozen=True, slots=True)
class MotionBlur:
    """exposure_s: how long the shutter is open."""

    exposure_s: float

    name: ClassVar[str] = "MotionBlur"
    unit: ClassVar[str] = PIXELS
    uses_geometry: ClassVar[bool] = True

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return how wide a point is spread at most."""
        return largest_way(summary, camera, self.exposure_s)

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: a mean is not brighter than the brightest, but for cubics' overshoot."""
        return summary

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the blurred picture."""
        ways = ImageWays(ImageMotion(camera, capture, light.dtype), self.exposure_s, light.dtype)
        counts = _counts(ways.speed_px_s, self.exposure_s)
        blurred = light.copy()
        if not counts.any():
            return blurred
        table = with_differences(light)
        flat = blurred.reshape(-1, 3)
        for count in np.unique(counts[counts > 0]):
            pixels = np.flatnonzero(counts == count)
            for chunk in np.array_split(pixels, len(pixels) // _CHUNK + 1):
                flat[chunk] = _mean(table, ways, chunk, sample_times(int(count), self.exposure_s))
        return np.maximum(blurred, light.dtype.type(0.0), out=blurred)

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return the camera's law, and how everything moves."""
        return motion_uniforms(camera, capture, self.exposure_s)


def _mean(
    table: npt.NDArray[Real], ways: ImageWays[Real], pixels: Whole, times: list[float]
) -> npt.NDArray[Real]:
    """Return the (n, 3) mean light that was carried to pixels at some times."""
    light = np.zeros((len(pixels), 3), dtype=table.dtype)
    ways_to = ways.to(pixels)
    for tau in np.array(times, dtype=table.dtype):
        light += moved_light(table, ways.motion, pixels, ways_to.aside(tau))
    return light / light.dtype.type(len(times))


def _counts(speed_px_s: npt.NDArray[Real], exposure_s: float) -> Whole:
    """Return at how many times each pixel is read; 0 where nothing moves."""
    width_px = speed_px_s * speed_px_s.dtype.type(exposure_s)
    counts = 1 + np.ceil(width_px / speed_px_s.dtype.type(_SPACING_PX)).astype(np.intp)
    return np.where(width_px > STILL_PX, np.minimum(counts, _MOST_TIMES), 0)


def sample_times(count: int, exposure_s: float) -> list[float]:
    """Return times about 0 with the variance of an exposure centred there; count: at least 2."""
    spread = exposure_s / math.sqrt(1.0 - 1.0 / count**2)
    return [((k + 0.5) / count - 0.5) * spread for k in range(count)]


KIND = Kind(
    "MotionBlur", MotionBlur, (Parameter("ExposureTime", "exposure_s", 1.0 / 60.0, 1e-6, 60.0),)
)
