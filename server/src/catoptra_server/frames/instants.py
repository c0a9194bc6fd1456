"""Compositions at an instant between two ticks, and compositions that show the same picture.

Robots move in ticks of 20 ms. In real time each frame shows the world a tick before its exposure,
where the path is known: a robot's mean motion in the last tick, followed back from the present
pose, begins exactly at the pose before. So frames of one tick differ, and no robot is shown where
it has not been, such as in a wall. Joints move with the tick. Under lockstep frames show the tick.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.kernels.grey_levels import FRAME_NOISE_EFFECTS
from catoptra_server.frames.frame import Carrier, FrameComposition, ViewRequest
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.world_description import integrate_poses


def rewind(composition: FrameComposition, lag_s: float) -> FrameComposition:
    """The composition some seconds earlier within the tick; the same object where nothing moves."""
    if not lag_s:
        return composition
    reference, metadata = composition.reference, composition.metadata
    views = [view for view in (*composition.views, reference) if view]
    # Each body once, in however many views, and all at once.
    objects = list({one for view in views for one in _list_objects(view.camera_state)})
    carriers = list({view.carrier for view in views if view.carrier})
    motions = [(one.world_from_object, one.twist) for one in objects]
    motions += [(one.world_from_robot, one.twist) for one in carriers]
    poses = integrate_poses(motions, -lag_s)
    if all(pose is before for pose, (before, _) in zip(poses, motions, strict=True)):
        return composition
    moved = dict(zip(objects, map(DynamicObject.with_pose, objects, poses), strict=True))
    carried = dict(zip(carriers, poses[len(objects) :], strict=True))
    rewind_view = partial(_rewind_view, objects=moved, carriers=carried)
    carrier = next((view.carrier for view in views), None)
    if metadata.robot and carrier is not None:
        metadata = replace(metadata, world_from_robot=carried[carrier])
    return replace(
        composition,
        views=tuple(view and rewind_view(view) for view in composition.views),
        reference=reference and rewind_view(reference),
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


def _list_objects(state: CameraState) -> tuple[DynamicObject, ...]:
    return (*state.objects, state.ego_body) if state.ego_body else state.objects


def _rewind_view(
    view: ViewRequest,
    objects: Mapping[DynamicObject, DynamicObject],
    carriers: Mapping[Carrier, Pose],
) -> ViewRequest:
    state, carrier = view.camera_state, view.carrier
    pose = state.world_from_mirror
    # With the robot: the camera's own twist is the tangent of its path.
    if carrier is not None and carriers[carrier] is not carrier.world_from_robot:
        pose = carriers[carrier] @ carrier.robot_from_camera
    state = replace(
        state,
        world_from_mirror=pose,
        objects=tuple(objects[one] for one in state.objects),
        ego_body=state.ego_body and objects[state.ego_body],
    )
    return replace(view, camera_state=state)


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
    if one is None or other is None or one is other:
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
