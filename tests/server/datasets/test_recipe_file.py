"""Recipe files: what they state, and errors that name file, line and key."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.known_names import bundled_files
from catoptra_server.datasets.recipe_file import read_recipe
from helpers.configs import find_line_number
from helpers.dataset_recipes import CAMERA, write_recipe


def test_recipe_states_worlds_cameras_and_numbers(tmp_path: Path) -> None:
    lines = ("Worlds=warehouse", "Channels=ids,range", "Formats=tum", "Name=small")
    recipe = read_recipe(write_recipe(tmp_path, lines=lines))
    assert [world.name for world in recipe.worlds] == ["corridor", "warehouse"]
    (camera,) = recipe.cameras
    assert camera.robot_file.name == "p2at_omni.ini"
    assert camera.size_px == (64, 64)
    assert recipe.channels == ("range", "ids"), "in the order of the table"
    assert (recipe.name, recipe.num_samples, recipe.seed) == ("small", 4, 7)
    assert recipe.renderer == "trace"


def test_instruction_set_is_accepted_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    read_recipe(write_recipe(tmp_path, lines=("InstructionSet=sse4.2",)))
    assert "InstructionSet has no effect" in caplog.text


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("Smaples=3", r"key.*did you mean Samples\?|Smaples"),
        ("Channels=depth", "there is|words of"),
        ("Worlds=nowhere", "nowhere"),
        ('Cameras=(Robot="p2at_omni",Widht=3)', "Widht"),
        ('Cameras=(Robot="nobody")', "nobody"),
        ("ShardSamples=0", "ShardSamples"),
        ("InstructionSet=mmx", "InstructionSet='mmx'"),
        ("Renderer=radiosity", "one of trace, raster"),
    ],
)
def test_wrong_line_is_named(tmp_path: Path, line: str, message: str) -> None:
    path = write_recipe(tmp_path, lines=(line,))
    with pytest.raises(ConfigError, match=message) as caught:
        read_recipe(path)
    assert caught.value.location.line == find_line_number(path, line)


def test_world_that_stands_twice_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="each world once, not corridor twice"):
        read_recipe(write_recipe(tmp_path, lines=("Worlds=corridor",)))


def test_file_without_the_section_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "recipe.ini"
    path.write_text("[Catoptra.Datasets]\nSamples=3\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"\[Catoptra\.Dataset\]"):
        read_recipe(path)


def test_flow_without_a_sequence_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="Poses=path or drive"):
        read_recipe(write_recipe(tmp_path, lines=("Channels=flow",)))


def test_random_poses_need_a_number_of_samples(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="Samples"):
        read_recipe(write_recipe(tmp_path, samples=0))


def test_given_poses_are_taken_once_by_each_camera_in_each_world(tmp_path: Path) -> None:
    grid = ("[Catoptra.GridPoses]", "X=(Min=0,Max=1,Count=3)", "Y=(Min=0,Max=0,Count=1)")
    path = write_recipe(
        tmp_path, *grid, samples=0, poses="grid", cameras=(CAMERA,), lines=("Worlds=warehouse",)
    )
    assert read_recipe(path).num_samples == 3 * 2


@pytest.mark.parametrize("path", bundled_files("datasets"), ids=lambda path: path.stem)
def test_bundled_recipe_is_read(path: Path) -> None:
    assert read_recipe(path).num_samples >= 100
