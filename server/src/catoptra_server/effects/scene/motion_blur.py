"""Motion blur: what moves through the picture while the shutter is open is spread along its way.

L' = the mean over the exposure of what is seen at each of its instants, in linear light, centred on
the pose: camera and bodies move on as they did in the last tick, each pixel by its own depth. Not a
change of the picture but of how often it is drawn: `render/scene_effects` gives the exposure a shutter,
`capture/shutter` has its instants. So what is uncovered, and what moves beside the camera, is as
right as a sharp picture. Domain: twists that stay during the exposure. Criterion: how wide a point
is spread at most, ring by ring of the image: the exposure times speed over the nearest range, and
turns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.effect import PIXELS, EffectBound, EffectParameter, EffectType
from catoptra_server.effects.kernels.image_speed import max_displacement
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class MotionBlur:
    """exposure_s: how long the shutter is open."""

    exposure_s: float

    name: ClassVar[str] = "MotionBlur"
    unit: ClassVar[str] = PIXELS

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return how wide a point is spread at most."""
        return max_displacement(summary, camera, self.exposure_s)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: a mean is not brighter than the brightest."""
        return summary


EFFECT_TYPE = EffectType(
    "MotionBlur",
    MotionBlur,
    (EffectParameter("ExposureTime", "exposure_s", 1.0 / 60.0, 1e-6, 60.0),),
)
