"""Data sets on disk: names of files, and the samples of a shard, a WebDataset tar file.

A folder holds `dataset.json`, written last, and `shards/000000.tar` and on. A member of a shard is
`<sample>.<suffix>`: 000042.rgb.png, 000042.range.npy, 000042.json. To add a channel's file: its row
in CHANNEL_FILES; its type and meaning are in `labels/__init__.py`.
"""

from __future__ import annotations

import hashlib
import tarfile
from collections.abc import Iterator
from pathlib import Path

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


def iterate_samples(path: Path, suffixes: frozenset[str] | None = None) -> Iterator[StoredSample]:
    """Yield the samples of a shard in the order of the file.

    Args:
        path: The shard.
        suffixes: Files to read; None for all. Those of other suffixes are skipped, not read.

    Raises:
        CatoptraError: The file cannot be read, or is no whole tar file.
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
                if suffixes is not None and suffix not in suffixes:
                    continue
                opened = shard.extractfile(member)
                content = opened.read() if opened is not None else b""
                if len(content) != member.size:
                    raise CatoptraError(f"{path}: {member.name} is cut off")
                files[suffix] = content
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
