"""Compositions between two ticks, and which of them show the same picture."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import EffectMode, EffectSetting, EffectSettings
from catoptra_server.frames.frame import Carrier, FrameComposition, FrameMetadata
from catoptra_server.frames.multi_view import TileLayout
from catoptra_server.frames.plan.camera import PerspectiveCameraSpec
from catoptra_server.simulation.frame_capture import rewind, show_same
from catoptra_server.world.objects import NoiseSeed
from catoptra_server.world.world_description import Twist
from helpers.dynamic_objects import build_cube_mesh, place_cube
from helpers.effect_measurement import make_effect
from helpers.frame_requests import SINGLE, VIEW

TICK_S = 0.02
NEXT_TICK = NoiseSeed((0, 0), 1)
# A quarter turn in a tick, on an arc about the origin.
BEFORE = Pose.from_rpy((1.0, 0.0, 0.0), (0.0, 0.0, 0.5 * math.pi))
AFTER = Pose.from_rpy((0.0, 1.0, 0.0), (0.0, 0.0, math.pi))
TWIST = Twist((-1.0 / TICK_S, 1.0 / TICK_S, 0.0), (0.0, 0.0, 0.5 * math.pi / TICK_S))
MOUNT = Pose.from_rpy((0.3, 0.1, -0.5), (0.0, 0.2, 0.0))


def make_composition() -> FrameComposition:
    """A camera on a robot that turns, beside one that drives by."""
    other = replace(place_cube(3.0, 0.0, 0.0), twist=Twist((2.0, 0.0, 0.0)))
    state = replace(
        VIEW.camera_state, world_from_mirror=AFTER @ MOUNT, objects=(other,), ego_body=other
    )
    view = replace(VIEW, camera_state=state, carrier=Carrier(AFTER, TWIST, MOUNT))
    return FrameComposition(SINGLE, (view, None), FrameMetadata("R", world_from_robot=AFTER))


def change_view(composition: FrameComposition, **changes: Any) -> FrameComposition:
    view = composition.views[0]
    assert view is not None
    return replace(composition, views=(replace(view, **changes), None))


def change_state(composition: FrameComposition, **changes: Any) -> FrameComposition:
    view = composition.views[0]
    assert view is not None
    return change_view(composition, camera_state=replace(view.camera_state, **changes))


def assert_close(pose: Pose, expected: Pose) -> None:
    np.testing.assert_allclose(pose.translation, expected.translation, atol=1e-12)
    np.testing.assert_allclose(pose.rotation, expected.rotation, atol=1e-12)


def test_composition_a_tick_before_is_that_of_the_tick_before() -> None:
    earlier = rewind(make_composition(), TICK_S)
    (view, black), metadata = earlier.views, earlier.metadata
    assert view is not None
    assert black is None
    assert_close(metadata.world_from_robot, BEFORE)
    # Exactly on the robot, however fast it turns.
    assert_close(view.camera_state.world_from_mirror, BEFORE @ MOUNT)
    assert view.camera_state.ego_body is not None
    for body in (*view.camera_state.objects, view.camera_state.ego_body):
        assert body.world_from_object.translation[0] == pytest.approx(2.96)


def test_composition_halfway_has_turned_by_half() -> None:
    metadata = rewind(make_composition(), 0.5 * TICK_S).metadata
    assert metadata.world_from_robot.to_rpy()[2] == pytest.approx(0.75 * math.pi)
    assert metadata.world_from_robot.translation == pytest.approx([0.5, 0.5, 0.0])


def test_composition_of_what_stands_stays_the_same_object() -> None:
    standing = FrameComposition(
        SINGLE, (replace(VIEW, carrier=Carrier(AFTER, Twist(), MOUNT)), None)
    )
    assert rewind(standing, TICK_S) is standing
    assert rewind(make_composition(), 0.0).metadata.world_from_robot is AFTER


def test_body_in_several_views_stays_one_object() -> None:
    (view, _) = make_composition().views
    assert view is not None
    earlier = rewind(FrameComposition(SINGLE, (view, replace(view))), TICK_S)
    first, second = (one.camera_state for one in earlier.views if one)
    assert first.objects[0] is second.objects[0] is first.ego_body
    assert first.world_from_mirror is not view.camera_state.world_from_mirror


def test_reference_of_a_variant_is_of_the_same_instant() -> None:
    composition = make_composition()
    earlier = rewind(replace(composition, reference=composition.views[0]), TICK_S)
    assert earlier.reference is not None
    assert_close(earlier.reference.camera_state.world_from_mirror, BEFORE @ MOUNT)


def test_compositions_of_equal_states_show_the_same_in_any_tick_without_noise() -> None:
    composition = make_composition()
    assert show_same(composition, change_state(composition, world_from_mirror=AFTER @ MOUNT))
    assert show_same(composition, change_state(composition, noise_seed=NEXT_TICK))
    settings = EffectSettings((EffectSetting(make_effect("ReadNoise"), EffectMode.AUTO),))
    noisy = change_view(composition, camera=replace(VIEW.camera, effect_settings=settings))
    assert show_same(noisy, noisy)
    assert not show_same(noisy, change_state(noisy, noise_seed=NEXT_TICK))


def test_compositions_that_differ_in_anything_visible_do_not_show_the_same() -> None:
    composition = make_composition()
    (other,) = composition.views[0].camera_state.objects  # type: ignore[union-attr]
    changed = [
        replace(composition, views=(None, None)),
        replace(composition, is_turned=True),
        replace(composition, reference=composition.views[0]),
        replace(composition, layout=TileLayout(1, 1, 8, 6, 8, 6)),
        change_view(composition, camera=PerspectiveCameraSpec(PerspectiveCamera(4, 3, 1.1))),
        change_view(composition, label_channels=("flow",)),
        change_state(composition, world_from_mirror=AFTER),
        change_state(composition, twist=TWIST),
        change_state(composition, objects=()),
        change_state(composition, objects=(replace(other, twist=TWIST),)),
        change_state(composition, objects=(replace(other, world_from_object=AFTER),)),
        change_state(composition, objects=(replace(other, mesh=build_cube_mesh(0.4)),)),
        change_state(composition, ego_body=None),
    ]
    assert [show_same(composition, one) for one in changed] == len(changed) * [False]
