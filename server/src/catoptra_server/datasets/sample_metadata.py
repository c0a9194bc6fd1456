"""Metadata of a sample as JSON: where and how its picture was taken, what was decided for it."""

from __future__ import annotations

import math
from typing import Any

from catoptra_protocol.camera_conf import pairs_from_omni_camera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.datasets.dataset_stage import RecipeWorld
from catoptra_server.datasets.sample import SampleDescription
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.views import RenderedView
from catoptra_server.simulation.sensors.sensor import SensorEnvironment
from catoptra_server.simulation.sight import compute_landmark_visibility


def describe_sample_metadata(
    description: SampleDescription, view: RenderedView, world: RecipeWorld
) -> dict[str, Any]:
    """Content of a sample's JSON file, without the objects that labels add.

    Args:
        description: The sample.
        view: Its picture as drawn.
        world: The world of the sample.
    """
    place, camera, state = description.place, description.camera, description.state
    optics = description.spec.camera
    height_m = camera.robot.viewpoint_height_m(camera.omni)
    twist = description.motion.twist
    return {
        "key": description.key,
        "index": place.index,
        "sequence": place.sequence,
        "step": place.step,
        "time_s": description.motion.time_s,
        "world": world.name,
        "camera": camera.name,
        "robot": camera.robot.class_name,
        "size_px": [optics.width_px, optics.height_px],
        "camera_model": [list(p) for p in pairs_from_omni_camera(optics, height_m)],
        "world_from_camera": describe_pose(state.world_from_mirror),
        "world_from_robot": describe_pose(description.motion.world_from_robot),
        "linear_m_s": [float(one) for one in twist.linear_m_s],
        "angular_rad_s": [float(one) for one in twist.angular_rad_s],
        "brightness": description.brightness,
        "noise_seed": [*state.noise_seed.camera_key, state.noise_seed.tick],
        "plan": view.frame_plan.plan_text,
        "error_bound_px": {k: _finite(v) for k, v in (view.frame_plan.bounds or {}).items()},
        "landmarks": _describe_landmarks(description, world),
        "effects": [_describe_decision(one) for one in view.effect_decisions],
    }


def describe_pose(pose: Pose) -> dict[str, list[float]]:
    """Position in metres, and unit quaternion x, y, z, w, of a frame in the world (SAE)."""
    return {
        "position_m": [float(one) for one in pose.translation],
        "quaternion_xyzw": [float(one) for one in pose.quaternion],
    }


def _describe_landmarks(description: SampleDescription, world: RecipeWorld) -> list[dict[str, Any]]:
    """Name, pixel (None outside the image), visibility and distance of each landmark's band."""
    world_from_camera = description.state.world_from_mirror
    found = compute_landmark_visibility(
        description.spec, world_from_camera, world.world.landmarks, SensorEnvironment(world.caster)
    )
    viewpoint = world_from_camera.translation
    return [
        {
            "name": one.landmark.name,
            "pixel": None if one.pixel is None else [*one.pixel],
            "visible": one.is_visible,
            "distance_m": math.dist(
                viewpoint, (one.landmark.x_m, one.landmark.y_m, -one.landmark.band_centre_m)
            ),
        }
        for one in found
    ]


def _describe_decision(decision: EffectDecision) -> dict[str, Any]:
    return {
        "effect": decision.effect,
        "enabled": decision.enabled,
        "bound": _finite(decision.bound),
        "threshold": _finite(decision.threshold),
        "displacement_px": _finite(decision.displacement_px),
        "change": _finite(decision.change),
        "reason": decision.reason,
    }


def _finite(value: float | None) -> float | None:
    """The number; None, which JSON has a text for, where it is not finite."""
    return None if value is None or not math.isfinite(value) else float(value)
