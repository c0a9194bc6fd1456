"""Compositions at an instant between two ticks, and compositions that show the same picture.

Robots move in ticks of 20 ms. In real time each frame shows the world a tick before its exposure,
where the path is known: a robot's mean motion in the last tick, followed back from the present
pose, begins exactly at the pose before. So frames of one tick differ, and no robot is shown where
it has not been, such as in a wall. Joints move with the tick. Under lockstep frames show the tick.
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.kernels.grey_levels import FRAME_NOISE_EFFECTS
from catoptra_server.frames.frame import Carrier, FrameComposition, ViewRequest
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.world_description import AT_REST


def rewind(composition: FrameComposition, lag_s: float) -> FrameComposition:
    """The composition some seconds earlier within the tick; the same object where nothing moves."""
    if not lag_s:
        return composition
    views = tuple(view and _rewind_view(view, lag_s) for view in composition.views)
    if _are_ones(views, composition.views):
        return composition
    reference, metadata = composition.reference, composition.metadata
    carrier = next((view.carrier for view in composition.views if view), None)
    if metadata.robot and carrier is not None:
        metadata = replace(metadata, world_from_robot=_rewind_carrier(carrier, lag_s))
    return replace(
        composition,
        views=views,
        reference=reference and _rewind_view(reference, lag_s),
        metadata=metadata,
    )


def show_same(first: FrameComposition, second: FrameComposition) -> bool:
    """Whether frames of two compositions of one channel are the same picture."""
    return (
        first.layout == second.layout
        and first.is_turned == second.is_turned
        and len(first.views) == len(second.views)
        and all(map(_views_show_same, first.views, second.views))
        and _views_show_same(first.reference, second.reference)
    )


def _rewind_view(view: ViewRequest, lag_s: float) -> ViewRequest:
    state, carrier = view.camera_state, view.carrier
    pose = state.world_from_mirror
    if carrier is not None and carrier.twist != AT_REST:
        # With the robot: the camera's own twist is the tangent of its path.
        moved = _rewind_carrier(carrier, lag_s) @ carrier.world_from_robot.inverse()
        pose = moved @ pose
    objects = tuple(_rewind_object(one, lag_s) for one in state.objects)
    if pose is state.world_from_mirror and _are_ones(objects, state.objects):
        return view
    ego_body = state.ego_body and _rewind_object(state.ego_body, lag_s)
    state = replace(state, world_from_mirror=pose, objects=objects, ego_body=ego_body)
    return replace(view, camera_state=state)


def _rewind_carrier(carrier: Carrier, lag_s: float) -> Pose:
    return carrier.twist.integrate_pose(carrier.world_from_robot, -lag_s)


def _rewind_object(moving: DynamicObject, lag_s: float) -> DynamicObject:
    pose = moving.twist.integrate_pose(moving.world_from_object, -lag_s)
    return moving if pose is moving.world_from_object else replace(moving, world_from_object=pose)


def _are_ones(first: Sequence[object], second: Sequence[object]) -> bool:
    """Whether two sequences of one length have the same objects."""
    return all(map(operator.is_, first, second))


def _views_show_same(first: ViewRequest | None, second: ViewRequest | None) -> bool:
    if first is None or second is None:
        return first is second
    # The flow of labels leads to another frame each time.
    if first.camera != second.camera or first.label_channels or second.label_channels:
        return False
    one, other = first.camera_state, second.camera_state
    settings = first.camera.effect_settings.settings
    has_noise = any(setting.effect.name in FRAME_NOISE_EFFECTS for setting in settings)
    return (
        _are_equal(one.world_from_mirror, other.world_from_mirror)
        and one.twist == other.twist
        and (not has_noise or one.noise_seed == other.noise_seed)
        and len(one.objects) == len(other.objects)
        and all(map(_objects_show_same, one.objects, other.objects))
        and _objects_show_same(one.ego_body, other.ego_body)
    )


def _objects_show_same(one: DynamicObject | None, other: DynamicObject | None) -> bool:
    if one is None or other is None:
        return one is other
    return (
        one.mesh is other.mesh
        and one.number == other.number
        and one.twist == other.twist
        and _are_equal(one.world_from_object, other.world_from_object)
    )


def _are_equal(one: Pose, other: Pose) -> bool:
    return one is other or (
        np.array_equal(one.translation, other.translation)
        and np.array_equal(one.rotation, other.rotation)
    )
