"""Folders of data sets: begun, resumed, refused, finished."""

from __future__ import annotations

import json
from collections import namedtuple
from dataclasses import replace
from pathlib import Path

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets import dataset_folder
from catoptra_server.datasets.dataset_folder import (
    DatasetIdentity,
    find_finished_shards,
    finish_folder,
    min_sample_bytes,
    open_folder,
    require_space,
)
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.datasets.shards import write_shard
from helpers.dataset_recipes import stage_recipe, write_drive, write_recipe

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
    # Channels that are not compressed: range 4, normal 6, point 12 and flow 8 bytes a pixel.
    assert 30 * 64 * 64 <= min_sample_bytes(stage, 0) <= 32 * 64 * 64
    usage = namedtuple("usage", "total used free")
    free = 1000 * min_sample_bytes(stage, 0)
    monkeypatch.setattr(dataset_folder.shutil, "disk_usage", lambda path: usage(0, 0, free))
    require_space(tmp_path, stage, 1000)
    with pytest.raises(CatoptraError, match=r"1001 samples take at least 0.1 GB"):
        require_space(tmp_path, stage, 1001)
