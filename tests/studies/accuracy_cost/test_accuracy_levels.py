from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_server.config.robot_file import read_robot
from catoptra_server.render.renderer import PerPixel
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation
from catoptra_studies.accuracy_cost.accuracy_levels import (
    AccuracyLevel,
    accuracy_sweep,
    level_robot_ini,
    quick_accuracy_sweep,
)
from helpers.configs import OMNI_ROBOT

SWEEP, QUICK = accuracy_sweep(360), quick_accuracy_sweep(360)


def tessellations(interpolation: Interpolation) -> set[tuple[int, int]]:
    surfaces = (level.render_settings.surface for level in SWEEP)
    return {
        (s.sectors, s.rings)
        for s in surfaces
        if isinstance(s, Tessellation) and s.interpolation is interpolation
    }


@pytest.mark.parametrize("interpolation", Interpolation)
def test_sweep_has_the_tessellations_of_both_shapes(interpolation: Interpolation) -> None:
    square = {(4, 4), (8, 8), (16, 16), (32, 32), (64, 64)}
    wide = {(8, 2), (16, 4), (32, 8), (64, 16), (128, 32)}
    assert tessellations(interpolation) == square | wide


def test_sweep_has_the_exact_mirror_by_both_renderers_with_1_to_4_samples() -> None:
    for kind in RendererKind:
        samples = {
            level.render_settings.samples
            for level in SWEEP
            if level.renderer_kind is kind and isinstance(level.render_settings.surface, PerPixel)
        }
        assert samples == {1, 2, 3, 4}


def test_sweep_has_faces_of_half_and_of_twice_the_plans_size() -> None:
    assert {level.render_settings.face_size_px for level in SWEEP} == {0, 180, 720}


@pytest.mark.parametrize("levels", [SWEEP, QUICK], ids=["whole", "quick"])
def test_levels_have_unique_names_and_eight_are_key(levels: tuple[AccuracyLevel, ...]) -> None:
    assert len({level.name for level in levels}) == len(levels)
    assert sum(level.is_key for level in levels) == 8


def test_key_levels_when_quick_are_those_of_the_whole_sweep() -> None:
    assert {s.name for s in QUICK if s.is_key} == {s.name for s in SWEEP if s.is_key}


@pytest.mark.parametrize("level", SWEEP, ids=lambda level: level.name)
def test_robot_ini_when_read_selects_the_level(level: AccuracyLevel, tmp_path: Path) -> None:
    path = tmp_path / "robot.ini"
    path.write_text(f"[Configuration]\nBasedOn={OMNI_ROBOT}\n{level_robot_ini(level, 200)}")
    omni = read_robot(path)[0].omni_camera
    assert omni is not None
    assert omni.camera.width_px == 200
    assert omni.render_settings == level.render_settings
