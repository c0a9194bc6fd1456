"""The self-test is within its bound and notices a displaced image; configurations are read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catoptra_server.commands.doctor.machine import Level
from catoptra_server.commands.doctor.self_test import check_configurations, run_self_test
from catoptra_server.config.known_names import bundled_files
from catoptra_server.render.renderer import Image, RenderedImage
from catoptra_server.render.trace.trace_renderer import TraceView
from helpers.configs import OMNI_ROBOT, Edit, find_line_number, write_edited_copy, write_small_world
from helpers.mesh_features import Gltf
from helpers.opengl import device_or_skip


def test_self_test_when_trace_renders_is_within_its_bound() -> None:
    values = run_self_test("trace")
    assert 0.0 < values["error_px"] <= values["bound_px"] < 0.5
    assert "kernel" in values["renderer"]


def test_self_test_when_raster_renders_is_within_its_bound() -> None:
    device_or_skip().close()
    values = run_self_test("raster")
    assert 0.0 < values["error_px"] <= values["bound_px"] < 0.5


@pytest.mark.parametrize(
    ("change", "error_px"),
    [
        (lambda rgb: np.roll(rgb, 2, axis=1), pytest.approx(2.0, abs=0.3)),
        (np.zeros_like, np.inf),
    ],
    ids=["shifted", "black"],
)
def test_error_when_the_frame_is_changed_is_the_displacement(
    monkeypatch: pytest.MonkeyPatch, change: Callable[[Image], Image], error_px: float
) -> None:
    render = TraceView.render

    def render_changed(*arguments: Any) -> RenderedImage:
        image = render(*arguments)
        return replace(image, rgb=change(image.rgb))

    monkeypatch.setattr(TraceView, "render", render_changed)
    assert run_self_test("trace")["error_px"] == error_px


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


def test_what_a_mesh_file_says_and_nobody_draws_is_a_warning(tmp_path: Path) -> None:
    mesh = Gltf(normalTexture={"index": 0}).texture().write(tmp_path)
    world = write_small_world(tmp_path, f"Meshes=(File={mesh.name})")
    found = list(check_configurations([], [world]))
    assert [f.level for f in found] == [Level.OK, Level.WARNING]
    text = "m.gltf: normal map: surfaces are shaded without its bumps (once)"
    assert found[1].message.endswith(text)


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
