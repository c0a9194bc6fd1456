from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_server.config.robot_file import read_robot
from catoptra_server.render.render_plan import PerPixel, RendererKind
from catoptra_server.scene.mirror_mesh import Interpolation, Tessellation
from catoptra_studies.accuracy_cost.accuracy_levels import (
    AccuracyLevel,
    accuracy_sweep,
    level_robot_ini,
    quick_accuracy_sweep,
)
from helpers.configs import OMNI_ROBOT

LADDER, QUICK = accuracy_sweep(360), quick_accuracy_sweep(360)


def splits(way: Interpolation) -> set[tuple[int, int]]:
    surfaces = (step.render_settings.surface for step in LADDER)
    return {
        (s.sectors, s.rings)
        for s in surfaces
        if isinstance(s, Tessellation) and s.interpolation is way
    }


@pytest.mark.parametrize("way", Interpolation)
def test_ladder_has_the_splits_of_both_shapes(way: Interpolation) -> None:
    square = {(4, 4), (8, 8), (16, 16), (32, 32), (64, 64)}
    wide = {(8, 2), (16, 4), (32, 8), (64, 16), (128, 32)}
    assert splits(way) == square | wide


def test_ladder_draws_the_exact_law_by_both_renderers_with_1_to_4_samples() -> None:
    for kind in RendererKind:
        samples = {
            step.render_settings.samples
            for step in LADDER
            if step.renderer_kind is kind and isinstance(step.render_settings.surface, PerPixel)
        }
        assert samples == {1, 2, 3, 4}


def test_ladder_has_faces_of_half_and_of_twice_the_plans_size() -> None:
    assert {step.render_settings.face_size_px for step in LADDER} == {0, 180, 720}


@pytest.mark.parametrize("steps", [LADDER, QUICK], ids=["whole", "quick"])
def test_steps_have_names_of_their_own_and_eight_are_key(steps: tuple[AccuracyLevel, ...]) -> None:
    assert len({step.name for step in steps}) == len(steps)
    assert sum(step.is_key for step in steps) == 8


def test_key_steps_of_a_quick_look_are_those_of_the_whole() -> None:
    assert {s.name for s in QUICK if s.is_key} == {s.name for s in LADDER if s.is_key}


@pytest.mark.parametrize("step", LADDER, ids=lambda step: step.name)
def test_robot_lines_when_read_ask_for_the_step(step: AccuracyLevel, tmp_path: Path) -> None:
    path = tmp_path / "robot.ini"
    path.write_text(f"[Configuration]\nBasedOn={OMNI_ROBOT}\n{level_robot_ini(step, 200)}")
    omni = read_robot(path)[0].omni_camera
    assert omni is not None
    assert omni.camera.width_px == 200
    assert omni.render_settings == step.render_settings
