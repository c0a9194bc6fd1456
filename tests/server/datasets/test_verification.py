"""Data sets read back: every kind of damage is found."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.dataset_folder import (
    DatasetIdentity,
    finish_folder,
    open_folder,
    verify_dataset,
)
from catoptra_server.datasets.png_files import encode_png
from catoptra_server.datasets.shards import write_shard

IDENTITY = DatasetIdentity("tour", "d" * 64, {}, "")
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


def write_dataset(folder: Path, *samples: tuple[str, dict[str, bytes]], number: int = 2) -> None:
    """Write a data set of one shard."""
    open_folder(folder, IDENTITY)
    record = write_shard(folder, 0, samples)
    finish_folder(folder, IDENTITY, [record], {"samples": number, "channels": ["range"]})


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
    write_dataset(tmp_path, sample("000000"), number=2)
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
