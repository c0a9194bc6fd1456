"""Shards read by the standard library: samples, skipped files, damage."""

from __future__ import annotations

import hashlib
import io
import tarfile
from pathlib import Path

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.labels import LABEL_CHANNELS
from catoptra_protocol.shards import CHANNEL_FILES, hash_file, iterate_samples, shard_name

FILES = {
    "000000.json": b"{}",
    "000000.rgb.png": b"p" * 700,
    "000001.json": b"[]",
    "000001.rgb.png": b"q" * 3,
}


def write_tar(path: Path, files: dict[str, bytes] = FILES) -> Path:
    """Write a tar file by the standard library."""
    with tarfile.open(path, "w") as shard:
        for name, content in files.items():
            info = tarfile.TarInfo(name)
            info.size = len(content)
            shard.addfile(info, io.BytesIO(content))
    return path


def test_every_channel_has_a_file() -> None:
    assert set(CHANNEL_FILES) == set(LABEL_CHANNELS)


def test_samples_are_grouped_by_their_names(tmp_path: Path) -> None:
    samples = [*iterate_samples(write_tar(tmp_path / "a.tar"))]
    assert [sample.key for sample in samples] == ["000000", "000001"]
    assert samples[0].files == {"json": b"{}", "rgb.png": b"p" * 700}


def test_files_of_other_suffixes_are_skipped(tmp_path: Path) -> None:
    path = write_tar(tmp_path / "a.tar")
    samples = [*iterate_samples(path, frozenset({"json"}))]
    assert [sample.files for sample in samples] == [{"json": b"{}"}, {"json": b"[]"}]


@pytest.mark.parametrize("length", [0, 100, 700, 1500])
def test_shard_when_cut_off_is_an_error(tmp_path: Path, length: int) -> None:
    path = write_tar(tmp_path / "a.tar")
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(CatoptraError, match=r"a\.tar"):
        list(iterate_samples(path))


def test_missing_shard_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(CatoptraError, match=r"none.tar"):
        list(iterate_samples(tmp_path / "none.tar"))
    with pytest.raises(CatoptraError, match=r"none.tar"):
        hash_file(tmp_path / "none.tar")


def test_hash_is_sha_256_of_the_whole_file(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"abc" * 1_000_000)
    assert hash_file(path) == hashlib.sha256(b"abc" * 1_000_000).hexdigest()
    assert shard_name(42) == "shards/000042.tar"
