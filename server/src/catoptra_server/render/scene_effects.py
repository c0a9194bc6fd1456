"""What is put into a scene, or taken account of, because a camera's effects ask for it."""

from __future__ import annotations

from dataclasses import replace

from catoptra_server.capture.camera_state import CameraState
from catoptra_server.capture.shutter import Shutter
from catoptra_server.effects.effect_plan import EffectPlan
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.scene.rolling_shutter import RollingShutter
from catoptra_server.effects.scene.self_view import SelfView
from catoptra_server.effects.scene.shadows import Shadows


def apply_scene_effects(camera_state: CameraState, plan: EffectPlan) -> CameraState:
    """Return the exposure of a scene that effects have changed."""
    exposure_s = readout_s = spread_px = carried_px = 0.0
    for effect in plan.scene_effects:
        match effect:
            case SelfView() if camera_state.ego_body is not None:
                camera_state = replace(
                    camera_state, objects=(*camera_state.objects, camera_state.ego_body)
                )
            case Shadows():
                camera_state = replace(camera_state, has_shadows=True)
            case MotionBlur():
                exposure_s = effect.exposure_s
                spread_px = plan.find_bound(effect.name)
            case RollingShutter():
                readout_s = effect.readout_s
                # Its bound is of the half before or after the pose.
                carried_px = 2.0 * plan.find_bound(effect.name)
    if spread_px == carried_px == 0.0:
        return camera_state
    shutter = Shutter.from_motion(
        exposure_s,
        readout_s,
        exposure_displacement_px=spread_px,
        readout_displacement_px=carried_px,
    )
    return replace(camera_state, shutter=shutter)
