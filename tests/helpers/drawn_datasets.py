"""Small data sets, drawn by this process or made of given pixels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_server.datasets.dataset_folder import DatasetIdentity, finish_folder, open_folder
from catoptra_server.datasets.dataset_run import DatasetRun
from catoptra_server.datasets.sample import RenderedSample, encode_sample
from catoptra_server.datasets.shards import ShardArtist, ShardJob, ShardRecord, write_shard
from helpers.dataset_recipes import stage_recipe


def draw_here(job: ShardJob, shards: Sequence[int]) -> Iterator[ShardRecord]:
    """Draw shards in this process, the last one first."""
    artist = ShardArtist(stage_recipe(Path(job.recipe_path)))
    for number in reversed(shards):
        yield artist.draw_shard(Path(job.folder), number)
    artist.close()


def draw_dataset(recipe: Path, folder: Path) -> Path:
    """Draw the whole data set of a recipe, and return its folder."""
    DatasetRun(recipe, folder).complete(draw_here)
    return folder


def make_sample(
    key: str,
    rgb: np.ndarray,
    channels: Mapping[str, np.ndarray],
    objects: Sequence[dict[str, Any]] = (),
) -> tuple[str, dict[str, bytes]]:
    """Key and files of a sample with these pixels, at the first instant of a first drive."""
    metadata = {"key": key, "world": "field", "camera": "paper", "sequence": 0, "time_s": 0.0}
    metadata |= {"brightness": 1.0, "objects": [*objects]}
    return key, encode_sample(RenderedSample(key, rgb, channels, metadata))


def write_dataset(
    folder: Path, *samples: tuple[str, dict[str, bytes]], num_samples: int | None = None
) -> None:
    """Write a finished data set of one shard; the manifest may state another number of samples."""
    identity = DatasetIdentity("tour", "d" * 64, {}, "")
    open_folder(folder, identity)
    record = write_shard(folder, 0, samples)
    number = len(samples) if num_samples is None else num_samples
    finish_folder(folder, identity, [record], {"samples": number, "channels": ["range"]})
