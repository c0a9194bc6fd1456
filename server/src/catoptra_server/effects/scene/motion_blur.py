"""Motion blur: moving objects are spread along their displacement while the shutter is open.

L' = the mean, in linear radiance, of the images at all times of the exposure, centred on the pose:
camera and objects continue their motion of the last tick, and each pixel moves by its own depth.
Not a change of the image but of the number of renderings: the camera state gets a shutter, whose
time samples are rendered and averaged. The native kernel does so only in those cells of 2 x 2
pixels that motion changes, at as many instants as their contrast takes, or, where all that is
around moves as one, from the samples of the sharp frame along each pixel's path: 99 % of pixels
within 2 and 99.9 % within 8 grey levels of the mean of 64 frames. Disocclusions, and objects that
move beside the camera, are therefore as right as in a sharp image. Domain: constant twists during
the exposure.
Criterion: the largest spread of a point, ring by ring of the image: exposure times (speed over
nearest distance, plus turns). Where it is not zero an edge may pass all samples of a pixel: the
contrast of black and the brightest.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

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
from catoptra_server.effects.kernels.warp import MOTION_FIELDS, bound_motion
from catoptra_server.world.objects import INSTANTANEOUS, CameraState


@dataclass(frozen=True, slots=True)
class MotionBlur:
    """Blur of an exposure time."""

    exposure_s: float
    """Time for which each row is exposed."""

    name: ClassVar[str] = "MotionBlur"
    changes_scene: ClassVar[bool] = True
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = MOTION_FIELDS

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Bound the change by the largest spread of a point."""
        # The whole exposure, though centred on the pose: a point is spread over both halves.
        return bound_motion(summary, camera, self.exposure_s)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: a mean is not brighter than its brightest part."""
        return summary

    def apply_to_scene(self, camera_state: CameraState, displacement_px: float) -> CameraState:
        """Camera state whose shutter is open for the exposure time."""
        # Enabled by the robot file without motion: one sharp image is the exact result.
        if displacement_px == 0.0:
            return camera_state
        shutter = (camera_state.shutter or INSTANTANEOUS).add_exposure(
            self.exposure_s, displacement_px
        )
        return replace(camera_state, shutter=shutter)


EFFECT_TYPE = EffectType(
    "MotionBlur",
    MotionBlur,
    (EffectParameter("ExposureTime", "exposure_s", 1.0 / 60.0, 1e-6, 60.0),),
)
