"""Descriptions of samples: a function of recipe and index."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from catoptra_server.datasets.sample import SampleDescriber
from helpers.dataset_recipes import stage_recipe, write_drive


def test_description_depends_on_recipe_and_index_alone(tmp_path: Path) -> None:
    stage = stage_recipe(write_drive(tmp_path))
    forward, backward = SampleDescriber(stage), SampleDescriber(stage)
    first = [forward.describe_sample(index) for index in range(6)]
    second = [backward.describe_sample(index) for index in reversed(range(6))][::-1]
    for one, other in zip(first, second, strict=True):
        assert (one.key, one.brightness, one.place) == (other.key, other.brightness, other.place)
        assert one.state.noise_seed == other.state.noise_seed
        for state, twin in ((one.state, other.state), (one.next_state, other.next_state)):
            assert state is not None
            assert twin is not None
            np.testing.assert_array_equal(
                state.world_from_mirror.rotation, twin.world_from_mirror.rotation
            )


def test_noise_differs_between_samples(tmp_path: Path) -> None:
    describer = SampleDescriber(stage_recipe(write_drive(tmp_path)))
    assert len({describer.describe_sample(index).state.noise_seed for index in range(6)}) == 6


def test_robot_is_seen_by_its_own_mirror_alone(tmp_path: Path) -> None:
    describer = SampleDescriber(stage_recipe(write_drive(tmp_path)))
    mirror, lens = describer.describe_sample(0), describer.describe_sample(2)
    assert mirror.state.ego_body is not None
    assert lens.state.ego_body is None
