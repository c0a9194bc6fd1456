"""Shards written whole or not at all, with the bytes that any worker would write."""

from __future__ import annotations

import errno
import io
import json
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.shards import iterate_samples, shard_name
from catoptra_server.datasets.shards import (
    ShardArtist,
    ShardJob,
    read_record,
    remove_parts,
    start_artist,
    write_shard,
    write_whole,
)
from catoptra_server.datasets.worker_environment import WorkerRefusedError
from helpers.dataset_recipes import stage_recipe, write_drive, write_recipe

SAMPLES = [("000000", {"json": b"{}", "rgb.png": b"p" * 600}), ("000001", {"json": b"[]"})]


class FullDisk(io.BytesIO):
    """File on a disk that is full after some bytes."""

    def __init__(self, room: int) -> None:
        super().__init__()
        self._room = room

    def write(self, content: bytes) -> int:  # type: ignore[override]
        """Write, or fail as the system does."""
        self._room -= len(content)
        if self._room < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(content)


def test_shard_is_a_tar_file_without_time_and_owner(tmp_path: Path) -> None:
    record = write_shard(tmp_path, 3, SAMPLES)
    path = tmp_path / "shards/000003.tar"
    with tarfile.open(path) as shard:
        members = shard.getmembers()
    assert [m.name for m in members] == ["000000.json", "000000.rgb.png", "000001.json"]
    assert {(m.mtime, m.uid, m.gid, m.uname, m.mode) for m in members} == {(0, 0, 0, "", 0o644)}
    assert [(s.key, s.files) for s in iterate_samples(path)] == SAMPLES
    assert (record.num_samples, record.num_bytes) == (2, path.stat().st_size)


def test_shard_has_the_same_bytes_again(tmp_path: Path) -> None:
    first, second = (write_shard(tmp_path / name, 0, SAMPLES) for name in "ab")
    assert first == second


def test_record_is_read_back_and_a_changed_shard_is_not_whole(tmp_path: Path) -> None:
    record = write_shard(tmp_path, 0, SAMPLES)
    assert read_record(tmp_path, 0) == record
    path = tmp_path / record.path
    content = bytearray(path.read_bytes())
    content[600] ^= 1
    path.write_bytes(bytes(content))
    assert read_record(tmp_path, 0) is None


@pytest.mark.parametrize("content", ["", "{", "[]", "{}", json.dumps({"sha256": 1})])
def test_shard_with_a_damaged_record_is_not_whole(tmp_path: Path, content: str) -> None:
    write_shard(tmp_path, 0, SAMPLES)
    (tmp_path / "shards/000000.json").write_text(content, encoding="utf-8")
    assert read_record(tmp_path, 0) is None


def replace_new_files(monkeypatch: pytest.MonkeyPatch, make_file: Callable[[], IO[bytes]]) -> None:
    """Write other files in place of those that are created."""
    open_path = Path.open

    def open_or_replace(path: Path, mode: str = "r", *args: Any, **kwargs: Any) -> IO[Any]:
        if mode != "xb":
            return open_path(path, mode, *args, **kwargs)
        open_path(path, mode).close()
        return make_file()

    monkeypatch.setattr(Path, "open", open_or_replace)


@pytest.mark.parametrize("room", [0, 700, 3000])
def test_full_disk_leaves_nothing_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    replace_new_files(monkeypatch, lambda: FullDisk(room))
    with pytest.raises(CatoptraError, match=r"the disk is full: .*000000.tar"):
        write_shard(tmp_path, 0, SAMPLES)
    assert list((tmp_path / "shards").iterdir()) == []
    assert read_record(tmp_path, 0) is None


def test_error_in_the_middle_leaves_nothing(tmp_path: Path) -> None:
    def samples():  # type: ignore[no-untyped-def]
        yield SAMPLES[0]
        raise CatoptraError("sample 000001: no")

    with pytest.raises(CatoptraError, match="sample 000001"):
        write_shard(tmp_path, 0, samples())
    assert list((tmp_path / "shards").iterdir()) == []


def test_folder_that_is_a_file_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "shards").write_text("", encoding="utf-8")
    with pytest.raises(CatoptraError, match="cannot be written"):
        write_shard(tmp_path, 0, SAMPLES)


def test_whole_file_replaces_an_older_one_and_parts_are_removed(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    write_whole(path, [b"old"])
    write_whole(path, [b"n", b"ew"])
    assert path.read_bytes() == b"new"
    (tmp_path / "b.tar.host.1.part").write_bytes(b"x")
    remove_parts(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


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


def test_full_disk_in_the_middle_of_a_shard_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    artist = ShardArtist(stage_recipe(write_drive(tmp_path)))
    replace_new_files(monkeypatch, lambda: open("/dev/full", "wb", buffering=0))
    with pytest.raises(CatoptraError, match=r"the disk is full: .*000000\.tar was not written"):
        artist.draw_shard(tmp_path, 0)
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
    job = ShardJob(str(path), str(tmp_path), "0" * 64, {"numpy": "1.0"})
    with pytest.raises(WorkerRefusedError, match="this worker differs"):
        start_artist(job)
