"""Ranges, levels, shards and names of a recipe."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_server.datasets.recipe import BrightnessLevels, ValueRange
from catoptra_server.datasets.recipe_file import read_recipe
from helpers.dataset_recipes import write_recipe


def test_range_draws_within_its_ends_and_takes_one_number_even_where_fixed() -> None:
    generator, other = np.random.default_rng(1), np.random.default_rng(1)
    drawn = [ValueRange(2.0, 3.0).draw(generator) for _ in range(100)]
    assert all(2.0 <= value <= 3.0 for value in drawn)
    assert max(drawn) - min(drawn) > 0.8
    for _ in range(100):
        assert ValueRange(5.0, 5.0).draw(other) == 5.0
    assert generator.random() == other.random()


def test_brightness_levels_include_both_ends() -> None:
    levels = BrightnessLevels(0.5, 1.5, 3)
    assert [levels.level(number) for number in range(3)] == [0.5, 1.0, 1.5]
    assert BrightnessLevels(0.7, 1.0, 1).level(0) == 0.7


@pytest.mark.parametrize(
    ("samples", "shards", "last"), [(1, 1, range(1)), (4, 2, range(2, 4)), (5, 3, range(4, 5))]
)
def test_shards_hold_every_sample_once(
    tmp_path: Path, samples: int, shards: int, last: range
) -> None:
    recipe = read_recipe(write_recipe(tmp_path, samples=samples))
    assert recipe.num_shards == shards
    assert recipe.shard_samples(shards - 1) == last
    found = [index for number in range(shards) for index in recipe.shard_samples(number)]
    assert found == list(range(samples))


def test_names_of_samples_sort_as_their_numbers(tmp_path: Path) -> None:
    recipe = read_recipe(write_recipe(tmp_path))
    assert recipe.sample_key(42) == "000042"
    large = replace(recipe, num_samples=20_000_000)
    assert large.sample_key(42) < large.sample_key(1_000_000) < large.sample_key(19_999_999)
