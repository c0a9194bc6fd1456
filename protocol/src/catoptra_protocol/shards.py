"""Data sets on disk: names of files, and the samples of a shard, a WebDataset tar file.

A folder holds `dataset.json`, written last, and `shards/000000.tar` and on. A member of a shard is
`<sample>.<suffix>`: 000042.rgb.png, 000042.range.npy, 000042.json. To add a channel's file: its row
in CHANNEL_FILES; its type and meaning are in `labels/__init__.py`.

Arrays may be compressed without loss, each a Zstandard frame of its own: 000042.range.npy.zst. Read
by the samples of here they have their names and bytes as without.
"""

from __future__ import annotations

import hashlib
import tarfile
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.slotted_dataclass import dataclass

MANIFEST_NAME = "dataset.json"
"""Manifest of a whole data set; a folder without one is not finished."""
UNFINISHED_NAME = "unfinished.json"
"""What a folder is going to hold, until the manifest takes its place."""
_SHARD_FOLDER = "shards"
FORMAT_VERSION = 1
PICTURE = "rgb.png"
METADATA = "json"

CHANNEL_FILES = {
    "range": "range.npy",
    "normal": "normal.npy",
    "point": "point.npy",
    "ids": "ids.png",
    "classes": "classes.png",
    "agreement": "agreement.png",
    "flow": "flow.npy",
    "valid": "valid.png",
}
"""Suffix of each channel's file."""

_BLOCK_BYTES = 2**20
_ZSTD = ".zst"
# 4 MB of channels: 1.84 MB in 5 ms; of level 3 1.69 MB in 11 ms.
_ZSTD_LEVEL = 1
_MAX_ARRAY_BYTES = 2**31


@dataclass(frozen=True, slots=True)
class StoredSample:
    """One sample of a shard, its files undecoded."""

    key: str
    """Name, such as 000042."""
    files: dict[str, bytes]
    """Content by suffix, such as rgb.png."""


def shard_name(number: int) -> str:
    """Path of a shard in a data set's folder."""
    return f"{_SHARD_FOLDER}/{number:06d}.tar"


@cache
def load_zstandard() -> Any:
    """Package that compresses and reads compressed arrays.

    Raises:
        CatoptraError: The package is missing.
    """
    try:
        import zstandard
    except ImportError as error:
        raise CatoptraError(
            "arrays with Compression=zstd need zstandard: pip install 'catoptra-client[zstd]' to "
            "read a data set, 'catoptra-server[zstd]' to draw one"
        ) from error
    return zstandard


def compress_arrays(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Files of a sample by suffix, NumPy's compressed.

    Raises:
        CatoptraError: zstandard is missing.
    """
    compress = load_zstandard().ZstdCompressor(level=_ZSTD_LEVEL).compress
    return dict(
        (suffix + _ZSTD, compress(content)) if suffix.endswith(".npy") else (suffix, content)
        for suffix, content in files.items()
    )


def decompress_file(suffix: str, content: bytes) -> tuple[str, bytes]:
    """Suffix and content of a sample's file without compression.

    Raises:
        CatoptraError: zstandard is missing, or the file is damaged.
    """
    if not suffix.endswith(_ZSTD):
        return suffix, content
    zstandard = load_zstandard()
    try:
        size = zstandard.frame_content_size(content)
        if not 0 <= size <= _MAX_ARRAY_BYTES:
            raise CatoptraError(f"{suffix} states a size of {size} bytes: it is damaged")
        return suffix.removesuffix(_ZSTD), zstandard.ZstdDecompressor().decompress(content)
    except zstandard.ZstdError as error:
        raise CatoptraError(f"{suffix} is damaged: {error}") from error


def iterate_samples(path: Path, suffixes: frozenset[str] | None = None) -> Iterator[StoredSample]:
    """Yield the samples of a shard in the order of the file.

    Args:
        path: The shard.
        suffixes: Files to read; None for all. Those of other suffixes are skipped, not read.

    Raises:
        CatoptraError: The file cannot be read, is no whole tar file, or needs zstandard.
    """
    key, files = "", dict[str, bytes]()
    try:
        _require_end(path)
        with tarfile.open(path, "r:") as shard:
            for member in shard:
                sample, _, suffix = member.name.partition(".")
                if sample != key and files:
                    yield StoredSample(key, files)
                    files = {}
                key = sample
                if suffixes is not None and suffix.removesuffix(_ZSTD) not in suffixes:
                    continue
                opened = shard.extractfile(member)
                content = opened.read() if opened is not None else b""
                if len(content) != member.size:
                    raise CatoptraError(f"{path}: {member.name} is cut off")
                plain, array = decompress_file(suffix, content)
                files[plain] = array
    except (OSError, tarfile.TarError, EOFError) as error:
        raise CatoptraError(f"{path} is no whole shard: {error}") from error
    if files:
        yield StoredSample(key, files)


def _require_end(path: Path) -> None:
    """Raise CatoptraError for a file without the two empty blocks that end an archive."""
    # A file that is cut off within the header of a member ends like a whole one for `tarfile`.
    end_bytes = 2 * tarfile.BLOCKSIZE
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - end_bytes))
        if file.read() != bytes(end_bytes):
            raise CatoptraError(f"{path} is no whole shard: its end is missing")


def hash_file(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal digits.

    Raises:
        CatoptraError: The file cannot be read.
    """
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            while block := file.read(_BLOCK_BYTES):
                digest.update(block)
    except OSError as error:
        raise CatoptraError(f"{path} cannot be read: {error.strerror or error}") from error
    return digest.hexdigest()
