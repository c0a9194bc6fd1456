"""Shards drawn in this process: the bytes that workers would write, errors that name the sample."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.shards import iterate_samples, shard_name
from catoptra_server.datasets.shards import (
    ShardArtist,
    ShardJob,
    WorkerRefusedError,
    open_for_writing,
    start_artist,
)
from helpers.dataset_recipes import stage_recipe, write_drive, write_recipe


def test_shard_has_its_samples_and_each_is_reported_before(tmp_path: Path) -> None:
    artist, begun = ShardArtist(stage_recipe(write_drive(tmp_path))), list[int]()
    record = artist.draw_shard(tmp_path, 1, begun.append)
    artist.close()
    assert begun == [2, 3]
    samples = [*iterate_samples(tmp_path / shard_name(1))]
    assert [sample.key for sample in samples] == ["000002", "000003"]
    assert len(samples[0].files) == 10
    assert record.num_samples == 2


def test_shards_have_the_same_hash_in_any_order(tmp_path: Path) -> None:
    path = write_drive(tmp_path)
    hashes = []
    for order in ((0, 1, 2), (2, 0, 1)):
        artist = ShardArtist(stage_recipe(path))
        records = [artist.draw_shard(tmp_path, number) for number in order]
        artist.close()
        hashes.append({record.number: record.sha256 for record in records})
    assert hashes[0] == hashes[1]


def test_full_disk_in_the_middle_of_a_shard_leaves_nothing(tmp_path: Path) -> None:
    def open_file(path: Path) -> BinaryIO:
        open_for_writing(path).close()
        return open("/dev/full", "wb", buffering=0)

    artist = ShardArtist(stage_recipe(write_drive(tmp_path)))
    with pytest.raises(CatoptraError, match=r"the disk is full: .*000000\.tar was not written"):
        artist.draw_shard(tmp_path, 0, open_file=open_file)
    artist.close()
    assert list((tmp_path / "shards").iterdir()) == []


def test_error_names_the_sample(tmp_path: Path) -> None:
    # On the roof of nothing: far from the corridor there is no floor.
    area = ("[Catoptra.RandomPoses]", "X=(Min=50,Max=51)", "Y=(Min=0,Max=1)", "MaxTries=3")
    artist = ShardArtist(stage_recipe(write_recipe(tmp_path, *area)))
    with pytest.raises(CatoptraError, match=r"sample 000002: .*no free pose"):
        artist.draw_shard(tmp_path, 1)
    artist.close()
    assert not (tmp_path / shard_name(1)).exists()


def test_worker_that_differs_is_refused(tmp_path: Path) -> None:
    path = write_recipe(tmp_path)
    job = ShardJob(str(path), str(tmp_path), "0" * 64, {}, "avx512")
    with pytest.raises(WorkerRefusedError, match=r"this worker differs|differ from|no avx512"):
        start_artist(replace(job, environment={"numpy": "1.0"}))
