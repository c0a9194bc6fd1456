"""Self view: the mirror looks down at the capture camera and at the robot that carries both.

Not a change of the image but one more object in the scene, rendered, lit and occluded like any
object. The ego body is fixed to the mirror, so it stays still in the image while the world turns.
Domain: central mirrors; the support between camera and mirror is transparent, and the mirror does
not see itself. Criterion: the image radius that the body reaches, r(min(theta, theta_rim)), with
theta the largest angle between the optical axis and any of its points, px; 0 if none of it is
within the rim.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import numpy as np

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.effect import PIXELS, EffectBound, EffectType
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class SelfView:
    """View of the ego body. No parameters: the robot file has the robot's dimensions."""

    name: ClassVar[str] = "SelfView"
    unit: ClassVar[str] = PIXELS
    changes_scene: ClassVar[bool] = True
    reads: ClassVar[frozenset[str]] = frozenset({"ego_body_max_angle_rad"})

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Image radius up to which the image shows the ego body."""
        # The whole radius and not the area: any pixel within may change from floor to robot, and
        # a threshold in px then means "visible beyond that radius".
        angle_rad = min(summary.ego_body_max_angle_rad, camera.rim_rad)
        if angle_rad == 0.0:
            return EffectBound(0.0, "no part of the robot is in view")
        ratio = camera.mirror.radius_ratio_from_t(np.array(math.tan(0.5 * angle_rad)))
        reason = f"the robot is in view up to {math.degrees(angle_rad):.1f} degrees from the axis"
        return EffectBound(camera.horizon_radius_px * float(ratio), reason)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of the scene with the ego body."""
        # Distances of the ego body stay apart from those of the scene: near surfaces count for
        # defocus, but surfaces that move with the camera do not count for motion blur.
        return replace(
            summary,
            attached_min_distances_m=summary.ego_body_min_distances_m,
            max_shadow_loss=summary.max_shadow_loss_with_ego_body,
        )

    def apply_to_scene(self, camera_state: CameraState, bound: float) -> CameraState:
        """Camera state with the ego body behind all dynamic objects."""
        if camera_state.ego_body is None:
            return camera_state
        return replace(camera_state, objects=(*camera_state.objects, camera_state.ego_body))


EFFECT_TYPE = EffectType("SelfView", SelfView)
