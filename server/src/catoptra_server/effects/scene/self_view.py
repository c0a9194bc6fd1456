"""Own body: the mirror looks down at the camera, and at the robot that carries both.

Not a change of the picture but one more body in the scene: `render/scene_effects` puts it there, and it
is drawn, lit and hidden as all bodies are. It hangs on the mirror, so it stands still in the
picture while the world turns around it. Domain: central mirrors; what carries the mirror is glass,
and the mirror does not see itself. Criterion: up to what image radius the body reaches, none
farther than the rim: r(min(theta, theta_rim)), theta the largest angle between the optical axis and
any of its points, in pixels; 0 where none of it is within the rim.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.effect import PIXELS, EffectBound, EffectType
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class SelfView:
    """No numbers: the robot's measures are its file's."""

    name: ClassVar[str] = "SelfView"
    unit: ClassVar[str] = PIXELS

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return the image radius up to which the picture shows the robot itself."""
        angle_rad = min(summary.ego_body_max_angle_rad, camera.rim_rad)
        if angle_rad == 0.0:
            return EffectBound(0.0, "the mirror sees nothing of the robot")
        ratio = camera.mirror.radius_ratio_from_t(np.array(math.tan(0.5 * angle_rad)))
        reason = f"the robot is seen up to {math.degrees(angle_rad):.1f} degrees from the axis"
        return EffectBound(camera.horizon_radius_px * float(ratio), reason)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the summary of a scene in which the robot stands."""
        return replace(
            summary,
            attached_min_distances_m=summary.ego_body_min_distances_m,
            max_shadow_loss=summary.max_shadow_loss_with_ego_body,
        )


EFFECT_TYPE = EffectType("SelfView", SelfView)
