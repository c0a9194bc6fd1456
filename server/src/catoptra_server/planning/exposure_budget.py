"""Budget of a long exposure: a limit of its time samples, each of which renders the whole image.

Counted in rays, not in milliseconds, so that a frame depends on its camera state and plan alone. An
object costs the rays that may meet it, and the placing of its triangles.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.effects.scene.motion_blur import MotionBlur
from catoptra_server.effects.scene.rolling_shutter import RollingShutter
from catoptra_server.planning.perspective_plan import PerspectivePlan
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.objects import DynamicObject

# 20 time samples of 640 x 640 px at 2 x 2 samples, 10 with one robot in all directions: half a
# second to a second on two cores. Robots at work need 2 to 4.
MAX_EXPOSURE_RAYS = 2**25
# An object of 704 triangles takes half a millisecond a time sample, whatever it covers; a ray takes
# 16 ns.
_RAYS_PER_TRIANGLE = 40


# Effects whose time samples are limited.
_SHUTTER_EFFECTS = frozenset((MotionBlur.name, RollingShutter.name))


def limit_time_samples(
    camera_state: CameraState, camera: RadialCamera, plan: RenderPlan | PerspectivePlan
) -> CameraState:
    """Camera state whose exposure stays within the budget of rays; itself without a shutter."""
    shutter = camera_state.shutter
    if shutter is None:
        return camera_state
    viewpoint, objects = camera_state.world_from_mirror.translation, camera_state.objects
    pixel_rays = camera.width_px * camera.height_px * plan.samples**2
    object_rays = sum(
        covered_fraction(one, viewpoint) * pixel_rays + _RAYS_PER_TRIANGLE * len(one.mesh)
        for one in objects
    )
    limit = min(int(MAX_EXPOSURE_RAYS / (pixel_rays + object_rays)), shutter.max_time_samples)
    return replace(camera_state, shutter=replace(shutter, max_time_samples=limit))


def covered_fraction(dynamic_object: DynamicObject, viewpoint: Floats) -> float:
    """Fraction of all directions from a (3,) point that an object's bounding sphere covers."""
    distance_m = float(np.linalg.norm(dynamic_object.centre - viewpoint))
    radius_m = dynamic_object.mesh.radius_m
    if distance_m <= radius_m:
        return 1.0
    return 0.5 * (1.0 - math.sqrt(1.0 - (radius_m / distance_m) ** 2))


def explain_limit(
    decisions: tuple[EffectDecision, ...], wanted: CameraState, limited: CameraState
) -> tuple[EffectDecision, ...]:
    """Decisions that say so where an exposure has fewer time samples than the effects want."""
    if wanted.shutter is None or limited.shutter is None:
        return decisions
    wanted_samples, samples = wanted.shutter.num_time_samples, limited.shutter.num_time_samples
    if wanted_samples == samples:
        return decisions
    note = f"{samples} of {wanted_samples} time samples, limited by the budget of a frame"
    return tuple(
        replace(one, reason=f"{one.reason}; {note}")
        if one.enabled and one.effect in _SHUTTER_EFFECTS
        else one
        for one in decisions
    )
