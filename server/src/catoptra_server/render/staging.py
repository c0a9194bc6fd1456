"""What is put into a scene, or taken account of, because a camera's effects ask for it."""

from __future__ import annotations

from dataclasses import replace

from catoptra_server.effects.decide import EffectPlan
from catoptra_server.effects.motion_blur import MotionBlur
from catoptra_server.effects.own_body import OwnBody
from catoptra_server.effects.rolling_shutter import RollingShutter
from catoptra_server.effects.shadows import Shadows
from catoptra_server.render.renderer import Exposure
from catoptra_server.render.shutter import Shutter
from catoptra_server.scene.motion import AT_REST, Twist


def staged(exposure: Exposure, plan: EffectPlan) -> Exposure:
    """Return the exposure of a scene that effects have changed."""
    exposure_s = readout_s = spread_px = carried_px = 0.0
    for effect in plan.staged:
        match effect:
            case OwnBody() if exposure.own_body is not None:
                exposure = replace(exposure, bodies=(*exposure.bodies, exposure.own_body))
            case Shadows():
                exposure = replace(exposure, has_shadows=True)
            case MotionBlur():
                exposure_s = effect.exposure_s
                spread_px = plan.bound(effect.name)
            case RollingShutter():
                readout_s = effect.readout_s
                # Its bound is of the half before or after the pose.
                carried_px = 2.0 * plan.bound(effect.name)
    if spread_px == carried_px == 0.0:
        return exposure
    shutter = Shutter.within(exposure_s, readout_s, spread_px=spread_px, carried_px=carried_px)
    return replace(exposure, shutter=shutter)


def scene_motion(exposure: Exposure) -> Twist:
    """Return the motion of the scene as the camera sees it: told at the viewpoint, mirror frame.

    In plain numbers, which take a tenth of the time of arrays of three: it is asked every frame.
    """
    if exposure.twist is AT_REST:
        return AT_REST
    axes = exposure.world_from_mirror.rotation.T.tolist()
    linear, angular = (
        tuple(-(a * x + b * y + c * z) for a, b, c in axes)
        for x, y, z in (exposure.twist.linear_m_s, exposure.twist.angular_rad_s)
    )
    return Twist(linear, angular)
