"""Which world, camera and light a sample has."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from catoptra_server.datasets.poses import (
    draw_brightness,
    find_place,
    random_source,
    sequence_length,
)
from catoptra_server.datasets.recipe_file import read_recipe
from helpers.dataset_recipes import CAMERA, FISHEYE, write_drive, write_recipe


def test_random_poses_go_through_all_worlds_and_cameras(tmp_path: Path) -> None:
    recipe = read_recipe(
        write_recipe(tmp_path, cameras=(CAMERA, FISHEYE), lines=("Worlds=warehouse",))
    )
    assert sequence_length(recipe) == 1
    places = [find_place(recipe, index) for index in range(8)]
    assert [(p.world, p.camera) for p in places] == [(0, 0), (0, 1), (1, 0), (1, 1)] * 2
    assert [p.sequence for p in places] == list(range(8))


def test_samples_of_a_drive_follow_each_other(tmp_path: Path) -> None:
    recipe = read_recipe(write_drive(tmp_path))
    places = [find_place(recipe, index) for index in range(6)]
    assert [(p.sequence, p.step, p.camera) for p in places] == [
        *((0, 0, 0), (0, 1, 0)),
        *((1, 0, 1), (1, 1, 1)),
        *((2, 0, 0), (2, 1, 0)),
    ]


def test_brightness_takes_all_levels_and_depends_on_the_index_alone(tmp_path: Path) -> None:
    recipe = read_recipe(write_drive(tmp_path))
    levels = [draw_brightness(recipe, index) for index in range(60)]
    assert set(Counter(levels)) == {0.5, 1.0, 1.5}
    assert draw_brightness(recipe, 17) == levels[17]


def test_random_numbers_of_purposes_are_independent(tmp_path: Path) -> None:
    recipe = read_recipe(write_recipe(tmp_path))
    drawn = {
        random_source(recipe, purpose).generator(index).random()
        for purpose in ("pose", "effects")
        for index in range(5)
    }
    assert len(drawn) == 10
