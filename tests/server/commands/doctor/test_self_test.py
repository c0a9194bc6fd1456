"""The self-test is within its bound and notices a displaced image; configurations are read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from catoptra_server.commands.doctor import self_test as module
from catoptra_server.commands.doctor.machine import Level
from catoptra_server.commands.doctor.self_test import (
    check_configurations,
    max_error_px,
    run_self_test,
)
from catoptra_server.config.known_names import bundled_files
from helpers.configs import OMNI_ROBOT, Edit, find_line_number, write_edited_copy, write_small_world
from helpers.opengl import device_or_skip


def test_self_test_when_trace_renders_is_within_its_bound() -> None:
    values = run_self_test("trace")
    assert 0.0 < values["error_px"] <= values["bound_px"] < 0.5
    assert "Embree" in values["renderer"]


def test_self_test_when_raster_renders_is_within_its_bound() -> None:
    device_or_skip().close()
    values = run_self_test("raster")
    assert 0.0 < values["error_px"] <= values["bound_px"] < 0.5


def test_error_when_the_frame_is_shifted_is_the_shift() -> None:
    directions = module._disc_directions()
    rgb = render_discs()
    shifted = np.roll(rgb, 2, axis=1)
    assert max_error_px(shifted, module._CAMERA, directions) == pytest.approx(2.0, abs=0.3)


def test_error_when_the_frame_is_black_is_infinite() -> None:
    black = np.zeros((360, 360, 3), np.uint8)
    assert max_error_px(black, module._CAMERA, module._disc_directions()) == np.inf


def render_discs() -> np.ndarray:
    """Frame of the self-test, rendered by trace."""
    from catoptra_protocol.optics.transforms import Pose
    from catoptra_server.frames.plan.plans import plan_from_settings
    from catoptra_server.frames.renderers import choose_renderer
    from catoptra_server.world.camera_state import CameraState
    from catoptra_server.world.scene_mesh import build_scene

    world = module._disc_world(module._disc_directions())
    choice = choose_renderer("trace", build_scene(world), world, threads=1)
    plan = plan_from_settings(
        module._RENDER_SETTINGS, module._CAMERA, kind=choice.kind, reason="test"
    )
    return choice.renderer.prepare(module._CAMERA, plan).render(CameraState(Pose.identity())).rgb


def test_bundled_files_when_checked_have_no_problem() -> None:
    found = list(check_configurations(bundled_files("robots"), bundled_files("worlds")))
    assert [f for f in found if f.level is not Level.OK] == []
    assert len(found) == len(bundled_files("robots")) + len(bundled_files("worlds"))


def test_robot_when_broken_is_a_fault_with_its_line(tmp_path: Path) -> None:
    path = write_edited_copy(OMNI_ROBOT, tmp_path, Edit("C=2.321", "C=two"))
    (found,) = check_configurations([path], [])
    assert found.level is Level.FAULT
    assert f"{path}:{find_line_number(path, 'C=two')}: C='two'" in found.message


def test_world_when_its_mesh_is_missing_is_a_fault(tmp_path: Path) -> None:
    (found,) = check_configurations([], [write_small_world(tmp_path, "Meshes=(File=none.glb)")])
    assert found.level is Level.FAULT
    assert "none.glb" in found.message


def test_key_when_misspelt_is_a_fault_in_our_sections_and_a_warning_in_others(
    tmp_path: Path,
) -> None:
    found = list(check_configurations([], [write_small_world(tmp_path, "Bxoes=()")]))
    assert [f.level for f in found] == [Level.OK, Level.FAULT]
    assert "Bxoes is unknown and has no effect; did you mean Boxes?" in found[1].message
    robot = write_edited_copy(OMNI_ROBOT, tmp_path, Edit("msgTimer", "msgTimr"))
    found = list(check_configurations([robot], []))
    assert [f.level for f in found] == [Level.OK, Level.WARNING]
    assert "did you mean msgTimer?" in found[1].message
