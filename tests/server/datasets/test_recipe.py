"""Values of recipes: ranges, words, levels, shards, effects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.unreal_ini import parse_sections
from catoptra_server.datasets.recipe import (
    BrightnessLevels,
    EffectOverrides,
    ValueRange,
    draw_effects,
    read_range,
    read_words,
)
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.effects import NO_EFFECT_SETTINGS, EffectMode, EffectSettings
from helpers.dataset_recipes import stage_recipe, write_recipe


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


def read_overrides(folder: Path, *lines: str) -> EffectOverrides:
    """Effects of a recipe."""
    return read_recipe(write_recipe(folder, "[Catoptra.Effects]", *lines)).effects


def draw(overrides: EffectOverrides, seed: int = 1, **camera: bool) -> EffectSettings:
    """Settings of one sample of a camera with a mirror and a viewpoint, unless stated."""
    kinds = {"has_mirror": True, "has_viewpoint": True, **camera}
    return draw_effects(overrides, NO_EFFECT_SETTINGS, np.random.default_rng(seed), **kinds)


def test_parameter_is_drawn_from_its_range(tmp_path: Path) -> None:
    overrides = read_overrides(tmp_path, "ShotNoise=always", "FullWell=(Min=5000,Max=9000)")
    wells = [draw(overrides, seed).settings[0].effect.full_well_e for seed in range(20)]
    assert all(5000.0 <= well <= 9000.0 for well in wells)
    assert len(set(wells)) == 20
    assert draw(overrides).settings[0].mode is EffectMode.ALWAYS


def test_curve_is_read_beside_the_recipe(tmp_path: Path) -> None:
    (tmp_path / "curve.csv").write_text("light,grey\n0,0\n0.4,180\n2,255\n")
    overrides = read_overrides(tmp_path, "Response=auto", "ResponseCurve=curve.csv")
    curve = draw(overrides).settings[0].effect.curve
    assert curve == ((0.0, 0.0), (0.4, 180.0), (2.0, 255.0))


def test_effect_of_a_mirror_is_left_out_for_a_lens(tmp_path: Path) -> None:
    overrides = read_overrides(tmp_path, "ShotNoise=auto", "SelfView=auto")
    assert {one.effect.name for one in draw(overrides).settings} == {"ShotNoise", "SelfView"}
    lens = draw(overrides, has_mirror=False)
    assert {one.effect.name for one in lens.settings} == {"ShotNoise"}


def test_effects_that_the_recipe_does_not_name_stay(tmp_path: Path) -> None:
    overrides = read_overrides(tmp_path, "ShotNoise=never")
    own = stage_recipe(write_recipe(tmp_path)).cameras[0].spec.effect_settings
    assert {one.effect.name for one in own.settings} == {"SelfView"}
    drawn = draw_effects(
        overrides, own, np.random.default_rng(1), has_mirror=True, has_viewpoint=True
    )
    assert {one.effect.name: one.mode for one in drawn.settings} == {
        "SelfView": EffectMode.AUTO,
        "ShotNoise": EffectMode.NEVER,
    }
    assert draw_effects(EffectOverrides(), own, np.random.default_rng(1), has_mirror=True,
                        has_viewpoint=True) is own  # fmt: skip


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("ShotNoise=sometimes", "one of auto, always, never"),
        ("ShotNose=always", "ShotNose"),
        ("FullWell=(Min=9,Max=8)", "Min at most Max"),
        ("FullWell=(Min=-5,Max=8)", "FullWell"),
        ("Response=auto\nResponseCurve=none.csv", "ResponseCurve='none.csv'"),
    ],
)
def test_wrong_effect_is_an_error_with_its_line(tmp_path: Path, line: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read_overrides(tmp_path, line)


DEFAULT = ValueRange(1.0, 2.0)


def section(line: str) -> SectionReader:
    """Section of one line."""
    (found,) = parse_sections(f"[Catoptra.X]\n{line}\n", file="recipe.ini")
    return SectionReader(found.name, SourceLocation("recipe.ini", 1), found.entries)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("Speed=3", ValueRange(3.0, 3.0)),
        ("Speed=(Min=-1,Max=4.5)", ValueRange(-1.0, 4.5)),
        ("Speed=(Min=2,Max=2)", ValueRange(2.0, 2.0)),
        ("Other=3", DEFAULT),
    ],
)
def test_range_is_a_struct_or_a_number(line: str, expected: ValueRange) -> None:
    assert read_range(section(line), "Speed", DEFAULT) == expected


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("Speed=(Min=2,Max=1)", "recipe.ini:2: Catoptra.X.Speed='(Min=2,Max=1)': .*Min at most"),
        ("Speed=(Min=0,Max=11)", "Speed.Max='11': expected a number from -5 to 10"),
        ("Speed=-6", "Speed='-6'"),
        ("Speed=(Min=0)", "Max"),
        ("Speed=fast", "Speed='fast'"),
    ],
)
def test_range_when_empty_or_out_of_bounds_is_an_error(line: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message.replace("(", r"\(").replace(")", r"\)")):
        read_range(section(line), "Speed", DEFAULT, min_value=-5.0, max_value=10.0)


def test_words_are_in_the_order_of_the_table() -> None:
    allowed = ("range", "ids", "flow")
    assert read_words(section("Channels=flow, Range"), "Channels", allowed, ()) == ("range", "flow")
    assert read_words(section("Channels=all"), "Channels", allowed, ()) == allowed
    assert read_words(section("Other=1"), "Channels", allowed, ("ids",)) == ("ids",)


def test_word_when_unknown_is_an_error_with_a_suggestion() -> None:
    with pytest.raises(ConfigError, match=r"recipe.ini:2: .*did you mean range\?"):
        read_words(section("Channels=ids,rnage"), "Channels", ("range", "ids"), ())
