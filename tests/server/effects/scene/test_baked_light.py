"""Bound of baked light: never below what a node changes on a surface of any albedo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.effects import EffectSettings, SceneSummary, name_effect
from catoptra_server.effects.effect_plan import apply_scene_effects, plan_effects
from catoptra_server.effects.kernels.grey_levels import find_changes
from catoptra_server.effects.scene.baked_light import BakedLight, find_grid_changes
from helpers.effect_measurement import make_baked_map
from helpers.worlds import CAMERA_STATE, make_omni_camera

CAMERA = make_omni_camera()


def make_summary(least: float, mean: float, largest: float) -> SceneSummary:
    light = make_baked_map((least / largest, mean / largest, 1.0))
    return SceneSummary(1.0, light_bake=light, open_irradiance=(largest,) * 3)


@pytest.mark.parametrize("gains", [(1.0, 1.0), (0.2, 3.0)])
@pytest.mark.parametrize("light", [(0.001, 0.002, 0.004), (0.5, 0.6, 0.8), (0.0, 2.0, 9.0)])
def test_bound_covers_every_node_on_every_surface(
    light: tuple[float, float, float], gains: tuple[float, float]
) -> None:
    summary = replace(make_summary(*light), gains=gains)
    bound = BakedLight().bound(summary, CAMERA).value
    for albedo in np.geomspace(1e-4, 1.0, 60):
        for added in (0.0, 0.002, 0.3):
            nodes = albedo * np.linspace(light[0], light[2], 30)[:, None] + added
            mean = np.full_like(nodes, albedo * light[1] + added)
            assert find_changes(nodes, mean, gains).max() <= bound + 1e-9


def test_bound_covers_means_of_surfaces_beyond_white_and_below() -> None:
    ranges = np.array([[8.0, 0.5], [5.5, 0.3], [8.0, 0.5]])[..., None] * np.ones(3)
    light = replace(make_baked_map((1.0, 1.0, 1.0)), ranges=ranges)
    summary = SceneSummary(1.0, light_bake=light, open_irradiance=(1.0,) * 3)
    bound = BakedLight().bound(summary, CAMERA).value
    for share in np.linspace(0.0, 1.0, 200):
        nodes, mean = ([share, 1.0 - share] @ one for one in ranges[:2])
        assert find_changes(nodes, mean, (1.0, 1.0)).max() <= bound < 60.0


def test_light_that_nobody_misses_is_left_out_of_a_camera() -> None:
    settings = name_effect(EffectSettings(), "BakedLight")
    assert name_effect(settings, "BakedLight") is settings
    for largest, is_drawn in ((0.502, False), (0.6, True)):
        summary = make_summary(0.5, 0.5, largest)
        plan = plan_effects(settings, summary, CAMERA)
        assert apply_scene_effects(CAMERA_STATE, plan).has_baked_light is is_drawn
    bound = BakedLight().bound(SceneSummary(1.0), CAMERA)
    assert (bound.value, bound.reason) == (0.0, "the world has no baked light")
    assert not find_grid_changes(np.zeros((3, 0, 3)), (1.0, 1.0)).size
