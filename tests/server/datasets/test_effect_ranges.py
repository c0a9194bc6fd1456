"""Effects of recipes: modes, ranges of parameters, cameras without a mirror."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.datasets.recipe import EffectOverrides, draw_effects
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.effects.effect import NO_EFFECT_SETTINGS, EffectMode, EffectSettings
from helpers.dataset_recipes import stage_recipe, write_recipe


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
    ],
)
def test_wrong_effect_is_an_error_with_its_line(tmp_path: Path, line: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read_overrides(tmp_path, line)
