"""Worlds and cameras of recipes, and the digest of all that samples follow from."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.worker_environment import WorkerRefusedError
from helpers.configs import ROBOTS, Edit, write_edited_copy, write_small_world
from helpers.dataset_recipes import CAMERA, FISHEYE, stage_recipe, write_recipe


def test_cameras_have_names_and_sizes(tmp_path: Path) -> None:
    cameras = stage_recipe(write_recipe(tmp_path, cameras=(CAMERA, FISHEYE))).cameras
    assert [camera.name for camera in cameras] == [
        "p2at_omni.OmniCamPillar_Link4",
        "equidistant_220",
    ]
    assert [camera.spec.camera.has_mirror for camera in cameras] == [True, False]
    assert {camera.spec.camera.width_px for camera in cameras} == {64}


def test_digest_depends_on_every_file_and_on_no_path(tmp_path: Path) -> None:
    digests = []
    edits = {
        "same": [],
        "other place": [],
        "recipe": [],
        "world": ["Background=(R=1,G=1,B=1)"],
        "robot": [],
    }
    for number, (name, world_lines) in enumerate(edits.items()):
        folder = tmp_path / str(number)
        folder.mkdir()
        write_small_world(folder, *world_lines)
        edit = Edit("K=11.546", "K=11.547" if name == "robot" else "K=11.546")
        write_edited_copy(ROBOTS / "p2at_omni.ini", folder, edit)
        lines = ("Name=other",) if name == "recipe" else ()
        camera = 'Cameras=(Robot="p2at_omni.ini")'
        path = write_recipe(folder, world="world.ini", cameras=(camera,), lines=lines)
        digests.append(stage_recipe(path).digest)
    assert digests[0] == digests[1]
    assert len(set(digests)) == 4


def test_digest_depends_on_the_names_of_a_mesh_file_s_nodes(tmp_path: Path) -> None:
    digests = set()
    for name in ("crate", "chest"):
        triangle = f"o {name}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
        (tmp_path / "mesh.obj").write_text(triangle, encoding="utf-8")
        write_small_world(tmp_path, 'Meshes=(File="mesh.obj",Position=(X=2,Y=2,Z=0))')
        digests.add(stage_recipe(write_recipe(tmp_path, world="world.ini")).digest)
    assert len(digests) == 2


def test_worker_with_other_files_is_refused(tmp_path: Path) -> None:
    stage = stage_recipe(write_recipe(tmp_path))
    stage.require_digest(stage.digest)
    with pytest.raises(WorkerRefusedError, match="differ from those of the driver"):
        stage.require_digest("0" * 64)


def test_camera_that_is_not_there_is_an_error_with_its_line(tmp_path: Path) -> None:
    camera = 'Cameras=(Robot="p2at_omni",Camera="Rear")'
    with pytest.raises(CatoptraError, match=r"recipe.ini:7: Cameras: .*Rear.*OmniCamPillar_Link4"):
        stage_recipe(write_recipe(tmp_path, cameras=(camera,)))


def test_two_cameras_of_one_name_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(CatoptraError, match="a second camera p2at_omni"):
        stage_recipe(write_recipe(tmp_path, cameras=(CAMERA, CAMERA)))


def test_camera_whose_plan_follows_measured_times_is_refused(tmp_path: Path) -> None:
    edit = Edit("FrameInterval=0.0 ", "MaxErrorPx=0.5\nFrameInterval=0.0 ")
    write_edited_copy(ROBOTS / "p2at_omni.ini", tmp_path, edit)
    path = write_recipe(tmp_path, cameras=('Cameras=(Robot="p2at_omni.ini")',))
    with pytest.raises(CatoptraError, match="accuracy target"):
        stage_recipe(path)
