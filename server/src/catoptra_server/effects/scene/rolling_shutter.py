"""Rolling shutter: the rows of an image are exposed one after the other.

Row v of h is exposed at t = readout ((v + 1/2) / h - 1/2), seconds from the pose, and shows the
scene at that time. Not a change of the image but of the number of renderings: the camera state gets
a shutter, whose time samples are rendered and weighted by row; in the native kernel each row has
its own pose. Source: CMOS sensors expose row by row; a CCD's global shutter has a readout of 0.
Domain: constant twists during the readout. Criterion: the largest displacement until a row is
exposed, ring by ring, by the farthest row that a ring reaches; as in `motion_blur`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    AVERAGING,
    EffectBound,
    EffectParameter,
    EffectType,
    Gains,
    SceneSummary,
)
from catoptra_server.effects.kernels.warp import (
    MOTION_FIELDS,
    bound_motion,
    ring_scales_and_radii,
)
from catoptra_server.world.objects import INSTANTANEOUS, CameraState


@dataclass(frozen=True, slots=True)
class RollingShutter:
    """Row-wise exposure with a readout time."""

    readout_s: float
    """Time between the exposures of the first row and of a row after the last."""

    name: ClassVar[str] = "RollingShutter"
    changes_scene: ClassVar[bool] = True
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = MOTION_FIELDS

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Bound the change by the largest displacement between the pose and a row's exposure."""
        if self.readout_s == 0.0:
            return EffectBound(0.0, "a global shutter")
        # Each ring with its own time: a ring of radius r only has rows that are exposed within
        # r / h of the readout from the pose.
        return bound_motion(summary, camera, self.readout_s * _max_readout_fractions(camera))

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: the scene appears displaced, not brighter."""
        return summary

    def apply_to_scene(self, camera_state: CameraState, displacement_px: float) -> CameraState:
        """Camera state whose shutter reads out row by row."""
        if displacement_px == 0.0:
            return camera_state
        # The displacement counts the half before or after the pose, the shutter both.
        shutter = camera_state.shutter or INSTANTANEOUS
        shutter = shutter.add_readout(self.readout_s, 2.0 * displacement_px)
        return replace(camera_state, shutter=shutter)


def _max_readout_fractions(camera: RadialCamera) -> Floats:
    """Fraction of the readout between the pose and the farthest row of each ring, (NUM_RINGS,)."""
    radius_px = ring_scales_and_radii(camera)[1]
    # The mirror's axis need not be on the central row, at which the pose is taken.
    centre = camera.centre_px[1] / camera.height_px - 0.5
    fractions: Floats = abs(centre) + radius_px / camera.height_px
    return np.minimum(fractions, 0.5)


EFFECT_TYPE = EffectType(
    "RollingShutter",
    RollingShutter,
    (EffectParameter("ReadoutTime", "readout_s", 0.0, 0.0, 1.0),),
)
