"""Calibrations, trajectories and further files beside the shards."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.dataset_folder import (
    describe_cameras,
    iterate_metadata,
    write_summaries,
)
from catoptra_server.datasets.shards import ShardArtist
from helpers.dataset_recipes import stage_recipe, write_drive


def test_trajectory_has_the_poses_of_each_drive_in_tum_s_order(tmp_path: Path) -> None:
    stage = stage_recipe(write_drive(tmp_path, lines=("Formats=tum",)))
    artist = ShardArtist(stage)
    for number in range(3):
        artist.draw_shard(tmp_path, number)
    artist.close()
    write_summaries(tmp_path, stage)
    metadata = [*iterate_metadata(tmp_path, stage.recipe)]
    assert [one["index"] for one in metadata] == list(range(6))
    files = sorted((tmp_path / "trajectories").iterdir())
    assert [path.name for path in files] == ["000000.txt", "000001.txt", "000002.txt"]
    rows = np.loadtxt(files[1])
    assert rows.shape == (2, 8)
    pose = metadata[3]["world_from_camera"]
    expected = [metadata[3]["time_s"], *pose["position_m"], *pose["quaternion_xyzw"]]
    np.testing.assert_allclose(rows[1], expected, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:], axis=1), 1.0, atol=1e-8)
    cameras = describe_cameras(tmp_path, stage)
    assert set(cameras) == {"p2at_omni.OmniCamPillar_Link4", "equidistant_220"}
    assert "calibration/equidistant_220/ray_table.npz" in cameras["equidistant_220"]["calibration"]


def test_missing_shard_is_an_error(tmp_path: Path) -> None:
    stage = stage_recipe(write_drive(tmp_path))
    with pytest.raises(CatoptraError, match=r"000000\.tar"):
        list(iterate_metadata(tmp_path, stage.recipe))


def draw(folder: Path, *lines: str) -> None:
    """Draw a drive and write its summaries."""
    stage = stage_recipe(write_drive(folder, lines=lines))
    artist = ShardArtist(stage)
    for number in range(3):
        artist.draw_shard(folder, number)
    artist.close()
    write_summaries(folder, stage)


def test_coco_file_has_all_pictures_and_their_objects(tmp_path: Path) -> None:
    draw(tmp_path, "Formats=coco")
    content = json.loads((tmp_path / "annotations.json").read_text(encoding="utf-8"))
    assert [image["file_name"] for image in content["images"]] == [
        f"00000{number}.rgb.png" for number in range(6)
    ]
    assert {(image["width"], image["height"]) for image in content["images"]} == {(64, 64)}
    assert {one["image_id"] for one in content["annotations"]} == set(range(1, 7))


# pycocotools 2.0 has the warning in its own conversion of masks.
@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
def test_pycocotools_loads_the_file(tmp_path: Path) -> None:
    coco = pytest.importorskip("pycocotools.coco", reason="needs the package pycocotools")
    draw(tmp_path, "Formats=coco")
    loaded = coco.COCO(tmp_path / "annotations.json")
    for annotation in loaded.loadAnns(loaded.getAnnIds()):
        assert loaded.annToMask(annotation).sum() == annotation["area"]
