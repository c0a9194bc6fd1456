"""Shards written whole or not at all."""

from __future__ import annotations

import errno
import io
import json
import tarfile
from pathlib import Path
from typing import BinaryIO

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.shards import iterate_samples
from catoptra_server.datasets.shards import (
    PART_SUFFIX,
    open_for_writing,
    read_record,
    record_path,
    remove_parts,
    write_shard,
    write_whole,
)

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
    record_path(tmp_path, 0).write_text(content, encoding="utf-8")
    assert read_record(tmp_path, 0) is None


@pytest.mark.parametrize("room", [0, 700, 3000])
def test_full_disk_leaves_nothing_and_says_so(tmp_path: Path, room: int) -> None:
    def open_file(path: Path) -> BinaryIO:
        open_for_writing(path).close()
        return FullDisk(room)

    with pytest.raises(CatoptraError, match=r"the disk is full: .*000000.tar"):
        write_shard(tmp_path, 0, SAMPLES, open_file)
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
    (tmp_path / f"b.tar.host.1{PART_SUFFIX}").write_bytes(b"x")
    remove_parts(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]
