"""The doctor's check of configuration files: valid, broken, misspelt."""

from __future__ import annotations

from pathlib import Path

from catoptra_server.commands.doctor.machine import Level
from catoptra_server.commands.doctor.self_test import check_configurations
from catoptra_server.config.known_names import bundled_files
from helpers.configs import OMNI_ROBOT, Edit, find_line_number, write_edited_copy, write_small_world


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
