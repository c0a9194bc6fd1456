"""A small data set, drawn by this process."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from catoptra_server.datasets.dataset_run import complete_run, prepare_run
from catoptra_server.datasets.shards import ShardArtist, ShardJob, ShardRecord
from helpers.dataset_recipes import stage_recipe


def draw_here(job: ShardJob, shards: Sequence[int]) -> Iterator[ShardRecord]:
    """Draw shards in this process, the last one first."""
    artist = ShardArtist(stage_recipe(Path(job.recipe_path)))
    for number in reversed(shards):
        yield artist.draw_shard(Path(job.folder), number)
    artist.close()


def draw_dataset(recipe: Path, folder: Path) -> Path:
    """Draw the whole data set of a recipe, and return its folder."""
    complete_run(prepare_run(recipe, folder), draw_here)
    return folder
