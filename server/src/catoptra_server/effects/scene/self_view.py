"""Self view: the mirror looks down at the capture camera and at the robot that carries both.

Not a change of the image but one more object in the scene, rendered, lit and occluded like any
object. The ego body is fixed to the mirror, so it stays still in the image while the world turns.
Domain: central mirrors; the support between camera and mirror is transparent, and the mirror does
not see itself. Criterion: the contrast of black and the brightest; 0 if no part of the body is
within the rim, by the largest angle between the optical axis and any of its points.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    NEEDS_MIRROR,
    UNCHANGED,
    EffectBound,
    EffectType,
    Gains,
    SceneSummary,
)
from catoptra_server.effects.kernels.grey_levels import max_change_by_exchange
from catoptra_server.world.objects import CameraState


@dataclass(frozen=True, slots=True)
class SelfView:
    """View of the ego body. No parameters: the robot file has the robot's dimensions."""

    name: ClassVar[str] = "SelfView"
    changes_scene: ClassVar[bool] = True
    gains: ClassVar[Gains] = UNCHANGED
    reads: ClassVar[frozenset[str]] = frozenset(
        {"ego_body_max_angle_rad", "ego_body_max_radiance", "max_radiance"}
    )

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Change from black to the brightest, if any of the ego body is in view."""
        assert isinstance(camera, OmniCamera), NEEDS_MIRROR
        angle_rad = min(summary.ego_body_max_angle_rad, camera.rim_rad)
        if angle_rad == 0.0:
            return EffectBound(0.0, "no part of the robot is in view")
        # Any pixel may change from floor to robot, so all of its light is others'.
        reason = f"the robot is in view up to {math.degrees(angle_rad):.1f} degrees from the axis"
        brightest = summary.gains[1] * max(summary.max_radiance, summary.ego_body_max_radiance)
        return EffectBound(max_change_by_exchange(1.0, brightest), reason)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Summary of the scene with the ego body."""
        # Distances of the ego body stay apart from the scene's: near surfaces count for
        # defocus, but surfaces that move with the camera do not count for motion blur.
        return replace(
            summary,
            max_radiance=max(summary.max_radiance, summary.ego_body_max_radiance),
            attached_min_distances_m=summary.ego_body_min_distances_m,
            max_shadow_loss=summary.max_shadow_loss_with_ego_body,
        )

    def apply_to_scene(self, camera_state: CameraState, displacement_px: float) -> CameraState:
        """Camera state with the ego body behind all dynamic objects."""
        if camera_state.ego_body is None:
            return camera_state
        return replace(camera_state, objects=(*camera_state.objects, camera_state.ego_body))


EFFECT_TYPE = EffectType("SelfView", SelfView, needs_mirror=True)
