"""A data set from its recipe to its manifest, by any workers; resumes where it was left."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.datasets.dataset_folder import (
    DatasetIdentity,
    find_finished_shards,
    finish_folder,
    open_folder,
    require_space,
)
from catoptra_server.datasets.dataset_stage import DatasetStage
from catoptra_server.datasets.drawing_environment import describe_environment
from catoptra_server.datasets.parquet_index import require_pyarrow
from catoptra_server.datasets.pinned_process import run_in_pinned_process
from catoptra_server.datasets.pose_sources import check_given_poses
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.datasets.shard_job import ShardJob
from catoptra_server.datasets.shard_writer import ShardRecord
from catoptra_server.datasets.summary_files import describe_cameras, write_summaries

# Draws shards by number, and yields their records in any order.
DrawShards = Callable[[ShardJob, Sequence[int]], Iterator[ShardRecord]]


@dataclass(frozen=True, slots=True, eq=False)
class PreparedRun:
    """A data set whose recipe is checked and whose folder is ready."""

    stage: DatasetStage
    folder: Path
    identity: DatasetIdentity
    job: ShardJob
    finished: tuple[ShardRecord, ...]
    """Shards of an earlier run."""
    is_whole: bool
    """Whether the folder already has its manifest."""

    @property
    def missing(self) -> list[int]:
        """Numbers of the shards to be drawn."""
        done = {record.number for record in self.finished}
        return [n for n in range(self.stage.recipe.num_shards) if n not in done]

    @property
    def num_finished_samples(self) -> int:
        """Samples of the shards of an earlier run."""
        return sum(record.num_samples for record in self.finished)


def prepare_run(recipe_path: Path, folder: Path) -> PreparedRun:
    """Check a recipe, and make its folder ready.

    Raises:
        ConfigError: A file is wrong: with file, line, key, value and the expected form.
        CatoptraError: A pose is not free, the folder holds something else, or the disk is full.
    """
    recipe = read_recipe(recipe_path)
    if "parquet" in recipe.formats:
        require_pyarrow()
    stage = DatasetStage(recipe)
    check_given_poses(stage)
    digest = run_in_pinned_process(recipe.instruction_set, digest_recipe, recipe_path)
    identity = DatasetIdentity(
        recipe.name, digest, describe_environment(recipe.instruction_set), recipe.text
    )
    is_whole = open_folder(folder, identity)
    finished = tuple(find_finished_shards(folder, recipe))
    job = ShardJob(
        str(recipe_path.resolve()),
        str(folder.resolve()),
        identity.digest,
        identity.environment,
        recipe.instruction_set,
    )
    run = PreparedRun(stage, folder, identity, job, finished, is_whole)
    num_missing = recipe.num_samples - run.num_finished_samples
    require_space(folder, stage, num_missing)
    return run


def digest_recipe(recipe_path: Path) -> str:
    """Digest of a recipe and its files, as this process understands them."""
    return DatasetStage(read_recipe(recipe_path)).digest


def complete_run(run: PreparedRun, draw: DrawShards) -> None:
    """Draw the missing shards, write the files beside them, and the manifest last.

    Raises:
        CatoptraError: A sample cannot be drawn, or a file not written.
    """
    records = [*run.finished]
    if run.missing:
        records += draw(run.job, run.missing)
    if len(records) != run.stage.recipe.num_shards:
        raise CatoptraError(f"{len(records)} of {run.stage.recipe.num_shards} shards were drawn")
    write_summaries(run.folder, run.stage)
    recipe = run.stage.recipe
    details = {
        "samples": recipe.num_samples,
        "seed": recipe.seed,
        "renderer": recipe.renderer,
        "instruction_set": recipe.instruction_set,
        "channels": list(recipe.channels),
        "formats": list(recipe.formats),
        "worlds": [world.name for world in recipe.worlds],
        "cameras": describe_cameras(run.folder, run.stage),
    }
    finish_folder(run.folder, run.identity, records, details)
