from __future__ import annotations

from dataclasses import replace

import numpy as np

from catoptra_server.render.renderer import advance, sample_shutter, trajectory
from catoptra_server.world.camera_state import Shutter
from helpers.effect_measurement import DRIVING_STATE
from helpers.motion_reference import camera_state_after, driving_camera_state


def test_camera_state_without_a_shutter_is_its_only_time_sample() -> None:
    ((sharp_state, weights),) = sample_shutter(DRIVING_STATE, 3)
    assert sharp_state is DRIVING_STATE
    assert weights.tolist() == [1.0, 1.0, 1.0]


def test_time_samples_are_sharp_and_advanced_by_every_motion() -> None:
    lasting = replace(DRIVING_STATE, shutter=Shutter(0.04, 0.0, 3))
    for (sharp_state, _), time_s in zip(
        sample_shutter(lasting, 2), (-0.04 / 3, 0.0, 0.04 / 3), strict=True
    ):
        expected = camera_state_after(DRIVING_STATE, time_s)
        assert sharp_state.shutter is None
        pairs = zip(
            (sharp_state.world_from_mirror, sharp_state.objects[0].world_from_object),
            (expected.world_from_mirror, expected.objects[0].world_from_object),
            strict=True,
        )
        for pose, other in pairs:
            np.testing.assert_allclose(pose.rotation, other.rotation, atol=1e-12)
            np.testing.assert_allclose(pose.translation, other.translation, atol=1e-12)


def test_time_samples_without_weight_in_any_row_are_left_out() -> None:
    # Two rows in a readout of four slots without exposure: the middles of two slots.
    lasting = replace(DRIVING_STATE, shutter=Shutter(0.0, 0.04, 4))
    assert [weights.tolist() for _, weights in sample_shutter(lasting, 2)] == [
        [1.0, 0.0],
        [0.0, 1.0],
    ]


def test_camera_state_advanced_by_no_time_is_unchanged() -> None:
    same = advance(DRIVING_STATE, 0.0)
    np.testing.assert_array_equal(
        same.world_from_mirror.translation, DRIVING_STATE.world_from_mirror.translation
    )


def test_trajectory_without_a_shutter_is_the_camera_state_itself() -> None:
    assert trajectory(DRIVING_STATE) == (DRIVING_STATE,)


def test_trajectory_is_evenly_spaced_from_the_begin_of_an_exposure_to_its_end() -> None:
    # 114 degrees in a second: 4 poses for 0.04 s of exposure and readout.
    turning = driving_camera_state(DRIVING_STATE.world_from_mirror, 0.5, 114.0)
    states = trajectory(replace(turning, shutter=Shutter(0.01, 0.03, 9.0)))
    assert len(states) == 4
    for state, time_s in zip(states, (-0.02, -0.02 / 3, 0.02 / 3, 0.02), strict=True):
        expected = camera_state_after(turning, time_s).world_from_mirror
        np.testing.assert_allclose(state.world_from_mirror.rotation, expected.rotation, atol=1e-12)


def test_trajectory_of_a_minute_of_spinning_has_a_limited_number_of_poses() -> None:
    spinning = driving_camera_state(DRIVING_STATE.world_from_mirror, 0.0, 720.0)
    assert len(trajectory(replace(spinning, shutter=Shutter(60.0, 0.0, 64.0)))) == 257
