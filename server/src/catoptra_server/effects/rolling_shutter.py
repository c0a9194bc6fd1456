"""Rolling shutter: the rows of a picture are exposed one after the other, not all at the pose.

L'(p) = L(q(tau)), tau = readout ((v + 0.5) / height - 0.5) in row v, q where what is at p at tau
was in the sharp picture (`image_ways`), read by cubics; the readout is centred on the pose.
Beyond the rim nothing is known: there, and for pixels that the rim goes through, a pixel keeps its
own light. Source: CMOS sensors expose row by row; a CCD's global shutter has a readout of 0.
Domain: twists that stay during the readout. Criterion: how far what the last rows show is carried,
ring by ring, as far from the middle row as a ring reaches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.capture import Capture
from catoptra_server.effects.cubic import with_differences
from catoptra_server.effects.effect import PIXELS, Bound, Kind, Parameter, Real, Uniforms
from catoptra_server.effects.image_motion import ImageMotion, motion_uniforms
from catoptra_server.effects.image_speed import largest_speeds, ring_scales, told
from catoptra_server.effects.image_ways import ImageWays
from catoptra_server.effects.moved_light import moved_light
from catoptra_server.effects.scene_summary import SceneSummary

# What is carried by less is left as it is: bytes stay the same where nothing moves.
STILL_PX = 0.05
_CHUNK = 1 << 14


@dataclass(frozen=True, slots=True)
class RollingShutter:
    """readout_s: from the first row's exposure to the last one's, and a row's time more."""

    readout_s: float

    name: ClassVar[str] = "RollingShutter"
    unit: ClassVar[str] = PIXELS
    uses_geometry: ClassVar[bool] = True

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return how far anything is carried at most until its row is exposed."""
        if self.readout_s == 0.0:
            return Bound(0.0, "a global shutter")
        times_s = self.readout_s * _largest_shares(camera)
        ways_px = times_s * largest_speeds(summary, camera)
        ring = int(ways_px.argmax())
        return Bound(float(ways_px[ring]), told(summary, ring, float(times_s[ring])))

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: what is shown is shown elsewhere."""
        return summary

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the picture as its rows see it."""
        carried = light.copy()
        if self.readout_s == 0.0:
            return carried
        ways = ImageWays(ImageMotion(camera, capture, light.dtype), self.readout_s, light.dtype)
        times = np.repeat(row_times(camera, self.readout_s).astype(light.dtype), camera.width_px)
        pixels = np.flatnonzero(ways.speed_px_s * np.abs(times) > STILL_PX)
        table = with_differences(light)
        for chunk in np.array_split(pixels, len(pixels) // _CHUNK + 1):
            aside = ways.to(chunk).aside(times[chunk])
            carried.reshape(-1, 3)[chunk] = moved_light(table, ways.motion, chunk, aside)
        return np.maximum(carried, light.dtype.type(0.0), out=carried)

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return the camera's law, and how everything moves."""
        # A duration of 0 is no way, but would divide.
        return motion_uniforms(camera, capture, max(self.readout_s, 1e-9))


def row_times(camera: OmniCamera, readout_s: float) -> npt.NDArray[np.float64]:
    """Return when each row is exposed, (h,) seconds from the pose."""
    rows: npt.NDArray[np.float64] = (np.arange(camera.height_px) + 0.5) / camera.height_px - 0.5
    return readout_s * rows


def _largest_shares(camera: OmniCamera) -> npt.NDArray[np.float64]:
    """Return how much of the readout lies between the pose and the farthest row of each ring."""
    radius_px = ring_scales(camera)[1]
    middle = camera.centre_px[1] / camera.height_px - 0.5
    shares: npt.NDArray[np.float64] = abs(middle) + radius_px / camera.height_px
    return np.minimum(shares, 0.5)


KIND = Kind(
    "RollingShutter", RollingShutter, (Parameter("ReadoutTime", "readout_s", 0.0, 0.0, 1.0),)
)
