"""A data set read back: every hash, every file of every sample."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.shards import (
    CHANNEL_FILES,
    FORMAT_VERSION,
    MANIFEST_NAME,
    METADATA,
    PICTURE,
    UNFINISHED_NAME,
    StoredSample,
    hash_file,
    iterate_samples,
)
from catoptra_server.datasets.png_files import decode_png


def verify_dataset(folder: Path) -> Iterator[str]:
    """Read a data set back, and yield a line about each shard.

    Raises:
        CatoptraError: Something is missing or damaged; names file and sample.
    """
    manifest = read_manifest(folder)
    suffixes = {PICTURE, METADATA, *(CHANNEL_FILES[name] for name in manifest["channels"])}
    num_samples = 0
    for shard in manifest["shards"]:
        path = folder / shard["path"]
        if hash_file(path) != shard["sha256"]:
            raise CatoptraError(f"{path} has another hash than {MANIFEST_NAME}: it is damaged")
        keys = [_check_sample(path, sample, suffixes) for sample in iterate_samples(path)]
        if len(keys) != shard["samples"] or keys != sorted(set(keys)):
            raise CatoptraError(f"{path} has {len(keys)} samples instead of {shard['samples']}")
        num_samples += len(keys)
        yield f"{path}: {len(keys)} samples, {shard['bytes']} bytes"
    if num_samples != manifest["samples"]:
        raise CatoptraError(f"{folder} has {num_samples} of {manifest['samples']} samples")
    yield f"{folder}: all {num_samples} samples are as they were written"


def read_manifest(folder: Path) -> dict[str, Any]:
    """Manifest of a whole data set.

    Raises:
        CatoptraError: The folder holds none, or one that is not finished.
    """
    path = folder / MANIFEST_NAME
    if not path.exists() and (folder / UNFINISHED_NAME).exists():
        raise CatoptraError(f"{folder} is not finished: run the command of its recipe again")
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
        if manifest["format"] != FORMAT_VERSION:
            raise CatoptraError(f"{path} is of format {manifest['format']}: not {FORMAT_VERSION}")
        return {name: manifest[name] for name in ("name", "channels", "shards", "samples")}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CatoptraError(f"{path} is no manifest of a data set: {error}") from error


def _check_sample(path: Path, sample: StoredSample, suffixes: set[str]) -> str:
    """Check the files of a sample; its name."""
    if set(sample.files) != suffixes:
        different = sorted(set(sample.files) ^ suffixes)
        raise CatoptraError(
            f"{path}: sample {sample.key}: {', '.join(different)} is missing or new"
        )
    try:
        shapes = {
            decode_array(suffix, content).shape[:2]
            for suffix, content in sample.files.items()
            if suffix != METADATA
        }
        key = json.loads(sample.files[METADATA])["key"]
    except (ValueError, KeyError, CatoptraError) as error:
        raise CatoptraError(f"{path}: sample {sample.key} cannot be read: {error}") from error
    if len(shapes) != 1 or key != sample.key:
        raise CatoptraError(f"{path}: sample {sample.key}: its files do not belong together")
    return sample.key


def decode_array(suffix: str, content: bytes) -> np.ndarray[Any, Any]:
    """Array of a sample's file.

    Raises:
        ValueError, DomainError: The file is damaged.
    """
    if suffix.endswith(".png"):
        return decode_png(content)
    array: np.ndarray[Any, Any] = np.load(io.BytesIO(content), allow_pickle=False)
    return array
