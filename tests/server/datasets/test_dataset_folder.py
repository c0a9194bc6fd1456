"""Folders of data sets: begun, resumed, refused, finished with all files, read back damaged."""

from __future__ import annotations

import builtins
import io
import json
from collections import namedtuple
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.shards import iterate_samples
from catoptra_server.datasets import dataset_folder
from catoptra_server.datasets.dataset_folder import (
    DatasetIdentity,
    describe_cameras,
    find_finished_shards,
    finish_folder,
    open_folder,
    require_space,
    verify_dataset,
    write_summaries,
)
from catoptra_server.datasets.dataset_stage import DatasetStage
from catoptra_server.datasets.png_files import encode_png
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.datasets.shards import ShardArtist, write_shard
from catoptra_server.datasets.writers import require_pyarrow
from helpers.dataset_recipes import stage_recipe, write_drive, write_recipe
from helpers.drawn_datasets import write_dataset

IDENTITY = DatasetIdentity("tour", "d" * 64, {"numpy": "2.4"}, "[Catoptra.Dataset]")
SAMPLES = [("000000", {"json": b"{}"})]


def test_new_folder_says_what_it_is_going_to_hold(tmp_path: Path) -> None:
    folder = tmp_path / "a/b"
    assert not open_folder(folder, IDENTITY)
    assert [p.name for p in folder.iterdir()] == ["unfinished.json"]
    assert not open_folder(folder, IDENTITY), "the same command goes on"


def test_finished_folder_has_a_manifest_and_is_whole(tmp_path: Path) -> None:
    open_folder(tmp_path, IDENTITY)
    record = write_shard(tmp_path, 0, SAMPLES)
    finish_folder(tmp_path, IDENTITY, [record], {"samples": 1})
    manifest = json.loads((tmp_path / "dataset.json").read_text())
    assert manifest["shards"] == [record.to_json()]
    assert manifest["digest"] == IDENTITY.digest
    assert not (tmp_path / "unfinished.json").exists()
    assert open_folder(tmp_path, IDENTITY)


@pytest.mark.parametrize("is_finished", [True, False])
@pytest.mark.parametrize(
    ("other", "message"),
    [
        (replace(IDENTITY, digest="e" * 64), "samples of another recipe"),
        (replace(IDENTITY, environment={"numpy": "2.5"}), "begun with another numpy"),
    ],
)
def test_folder_of_another_recipe_or_code_is_refused(
    tmp_path: Path, other: DatasetIdentity, message: str, is_finished: bool
) -> None:
    open_folder(tmp_path, IDENTITY)
    if is_finished:
        finish_folder(tmp_path, IDENTITY, [write_shard(tmp_path, 0, SAMPLES)], {})
    with pytest.raises(CatoptraError, match=message):
        open_folder(tmp_path, other)


def test_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("", encoding="utf-8")
    with pytest.raises(CatoptraError, match="is not empty"):
        open_folder(tmp_path, IDENTITY)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("content", ["{", "[]"])
def test_folder_with_a_damaged_manifest_is_refused(tmp_path: Path, content: str) -> None:
    (tmp_path / "dataset.json").write_text(content, encoding="utf-8")
    with pytest.raises(CatoptraError, match=r"dataset.json"):
        open_folder(tmp_path, IDENTITY)


def test_finished_shards_are_those_whose_bytes_have_their_hash(tmp_path: Path) -> None:
    recipe = read_recipe(write_recipe(tmp_path, samples=6))
    for number in range(3):
        write_shard(tmp_path, number, SAMPLES)
    (tmp_path / "shards/000001.tar").write_bytes(b"damaged")
    assert [record.number for record in find_finished_shards(tmp_path, recipe)] == [0, 2]


def test_disk_without_room_is_refused_before_anything_is_drawn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = stage_recipe(write_drive(tmp_path))
    usage = namedtuple("usage", "total used free")
    # Channels that are not compressed: range 4, normal 6, point 12 and flow 8 bytes a pixel.
    free = 1000 * 32 * 64 * 64
    monkeypatch.setattr(dataset_folder.shutil, "disk_usage", lambda path: usage(0, 0, free))
    require_space(tmp_path, stage, 1000)
    with pytest.raises(
        CatoptraError, match=r"has 131 MB of free space, and 1067 samples take at least 132 MB"
    ):
        require_space(tmp_path, stage, 1067)


def draw(folder: Path, *lines: str) -> DatasetStage:
    """Draw a drive and write its summaries."""
    stage = stage_recipe(write_drive(folder, lines=lines))
    artist = ShardArtist(stage)
    for number in range(3):
        artist.draw_shard(folder, number)
    artist.close()
    write_summaries(folder, stage)
    return stage


def test_index_has_a_row_for_each_sample(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs the extra [parquet]")
    draw(tmp_path, "Formats=parquet")
    table = parquet.read_table(tmp_path / "index.parquet")
    assert table.column("key").to_pylist() == [f"{index:06d}" for index in range(6)]
    assert len(set(table.column("x_m").to_pylist())) == 6


def test_missing_package_is_an_error_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    original = builtins.__import__

    def refuse(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.startswith("pyarrow"):
            raise ImportError(name)
        return original(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(CatoptraError, match=r"catoptra-server\[parquet\]"):
        require_pyarrow()


def test_trajectory_has_the_poses_of_each_drive_in_tum_s_order(tmp_path: Path) -> None:
    stage = draw(tmp_path, "Formats=tum")
    (_, sample) = iterate_samples(tmp_path / "shards/000001.tar")
    metadata = json.loads(sample.files["json"])
    assert metadata["index"] == 3
    files = sorted((tmp_path / "trajectories").iterdir())
    assert [path.name for path in files] == ["000000.txt", "000001.txt", "000002.txt"]
    rows = np.loadtxt(files[1])
    assert rows.shape == (2, 8)
    pose = metadata["world_from_camera"]
    expected = [metadata["time_s"], *pose["position_m"], *pose["quaternion_xyzw"]]
    np.testing.assert_allclose(rows[1], expected, atol=1e-8)
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:], axis=1), 1.0, atol=1e-8)
    cameras = describe_cameras(tmp_path, stage)
    assert set(cameras) == {"p2at_omni.OmniCamPillar_Link4", "equidistant_220"}
    assert "calibration/equidistant_220/ray_table.npz" in cameras["equidistant_220"]["calibration"]


def test_missing_shard_is_an_error(tmp_path: Path) -> None:
    stage = stage_recipe(write_drive(tmp_path, lines=("Formats=tum",)))
    with pytest.raises(CatoptraError, match=r"000000\.tar"):
        write_summaries(tmp_path, stage)


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


PICTURE = encode_png(np.arange(60, dtype=np.uint8).reshape(4, 5, 3))
RANGE_FILE = io.BytesIO()
np.save(RANGE_FILE, np.ones((4, 5), np.float32))
RANGE = RANGE_FILE.getvalue()


def sample(key: str, **files: bytes | None) -> tuple[str, dict[str, bytes]]:
    """Sample of a picture and its ranges; None leaves a file out."""
    metadata = json.dumps({"key": key}).encode()
    all_files = {"json": metadata, "range.npy": RANGE, "rgb.png": PICTURE}
    all_files |= {name.replace("_", "."): content for name, content in files.items()}
    return key, {name: content for name, content in all_files.items() if content is not None}


def test_whole_data_set_passes(tmp_path: Path) -> None:
    write_dataset(tmp_path, sample("000000"), sample("000001"))
    assert list(verify_dataset(tmp_path))[-1].endswith("all 2 samples are as they were written")


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (sample("000001", range_npy=None), r"sample 000001: range\.npy is missing"),
        (sample("000001", flow_npy=RANGE), r"flow\.npy is missing or new"),
        (sample("000001", rgb_png=PICTURE[:-9]), "sample 000001 cannot be read"),
        (sample("000001", range_npy=RANGE[:40]), "sample 000001 cannot be read"),
        (sample("000001", json=b"{"), "sample 000001 cannot be read"),
        (sample("000001", json=b'{"key":"000007"}'), "do not belong together"),
        (sample("000001", rgb_png=encode_png(np.zeros((3, 5, 3), np.uint8))), "do not belong"),
        (sample("000000"), "has 1 samples instead of 2"),
    ],
)
def test_damaged_sample_is_named(
    tmp_path: Path, second: tuple[str, dict[str, bytes]], message: str
) -> None:
    write_dataset(tmp_path, sample("000000"), second)
    with pytest.raises(CatoptraError, match=message):
        list(verify_dataset(tmp_path))


def test_changed_byte_is_found_by_the_hash(tmp_path: Path) -> None:
    write_dataset(tmp_path, sample("000000"), sample("000001"))
    path = tmp_path / "shards/000000.tar"
    content = bytearray(path.read_bytes())
    content[-1] = 1
    path.write_bytes(bytes(content))
    with pytest.raises(CatoptraError, match="another hash"):
        list(verify_dataset(tmp_path))


def test_missing_samples_and_shards_are_found(tmp_path: Path) -> None:
    write_dataset(tmp_path, sample("000000"), num_samples=2)
    with pytest.raises(CatoptraError, match="has 1 of 2 samples"):
        list(verify_dataset(tmp_path))
    (tmp_path / "shards/000000.tar").unlink()
    with pytest.raises(CatoptraError, match=r"000000\.tar cannot be read"):
        list(verify_dataset(tmp_path))


def test_unfinished_data_set_is_told_apart(tmp_path: Path) -> None:
    open_folder(tmp_path, IDENTITY)
    with pytest.raises(CatoptraError, match="is not finished"):
        list(verify_dataset(tmp_path))
    with pytest.raises(CatoptraError, match="no manifest"):
        list(verify_dataset(tmp_path / "none"))
