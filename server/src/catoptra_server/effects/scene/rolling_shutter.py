"""Rolling shutter: the rows of a picture are exposed one after the other, not all at the pose.

Row v of h is exposed at t = readout ((v + 1/2) / h - 1/2), seconds from the pose, and shows what is
seen then. Not a change of the picture but of how often it is drawn: `render/scene_effects` gives the
exposure a shutter, `capture/shutter` has its instants and what each counts in a row. Source: CMOS
sensors expose row by row; a CCD's global shutter has a readout of 0. Domain: twists that stay
during the readout. Criterion: how far what the last rows show is carried, ring by ring, as far from
the middle row as a ring reaches.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.effect import PIXELS, EffectBound, EffectParameter, EffectType
from catoptra_server.effects.kernels.image_speed import (
    describe_motion,
    max_speeds_px_s,
    ring_scales_and_radii,
)
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class RollingShutter:
    """readout_s: from the first row's exposure to the last one's, and a row's time more."""

    readout_s: float

    name: ClassVar[str] = "RollingShutter"
    unit: ClassVar[str] = PIXELS

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return how far anything is carried at most until its row is exposed."""
        if self.readout_s == 0.0:
            return EffectBound(0.0, "a global shutter")
        times_s = self.readout_s * _max_readout_fractions(camera)
        ways_px = times_s * max_speeds_px_s(summary, camera)
        ring = int(ways_px.argmax())
        return EffectBound(
            float(ways_px[ring]), describe_motion(summary, ring, float(times_s[ring]))
        )

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: what is shown is shown elsewhere."""
        return summary


def _max_readout_fractions(camera: OmniCamera) -> Floats:
    """Return how much of the readout lies between the pose and the farthest row of each ring."""
    radius_px = ring_scales_and_radii(camera)[1]
    middle = camera.centre_px[1] / camera.height_px - 0.5
    shares: Floats = abs(middle) + radius_px / camera.height_px
    return np.minimum(shares, 0.5)


EFFECT_TYPE = EffectType(
    "RollingShutter", RollingShutter, (EffectParameter("ReadoutTime", "readout_s", 0.0, 0.0, 1.0),)
)
