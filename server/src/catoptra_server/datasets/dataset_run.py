"""A data set from recipe to manifest, by any workers, with progress on standard error.

A run resumes where another ended: the recipe is checked and compared with the folder before
anything is drawn, and shards that are whole are not drawn again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TextIO

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.shards import load_zstandard
from catoptra_server.datasets.dataset_folder import (
    DatasetIdentity,
    describe_cameras,
    find_finished_shards,
    finish_folder,
    open_folder,
    require_space,
    write_summaries,
)
from catoptra_server.datasets.dataset_stage import DatasetStage
from catoptra_server.datasets.poses import check_given_poses
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.datasets.shards import ShardJob, ShardRecord
from catoptra_server.datasets.worker_environment import ZSTANDARD, describe_environment
from catoptra_server.datasets.writers import require_pyarrow

# Often enough to watch, seldom enough for a log.
_TERMINAL_INTERVAL_S = 0.5
_LOG_INTERVAL_S = 30.0
# Draws shards by number, and yields their records in any order.
_DrawShards = Callable[[ShardJob, Sequence[int]], Iterator[ShardRecord]]


class DatasetRun:
    """A data set whose recipe is checked and whose folder is ready."""

    def __init__(self, recipe_path: Path, folder: Path) -> None:
        """Check a recipe, and make the folder ready.

        Raises:
            CatoptraError: The recipe cannot be drawn, or the folder holds something else.
        """
        self.recipe = recipe = read_recipe(recipe_path)
        self.folder = folder
        if "parquet" in recipe.formats:
            require_pyarrow()
        if recipe.compression != "none":
            load_zstandard()
        self._stage = DatasetStage(recipe)
        check_given_poses(self._stage)
        digest = self._stage.digest
        environment = describe_environment()
        if recipe.compression == "none":
            environment = {k: v for k, v in environment.items() if k != ZSTANDARD}
        self._identity = DatasetIdentity(recipe.name, digest, environment, recipe.text)
        # Whether the folder already has a manifest.
        self.is_whole = open_folder(folder, self._identity)
        self._finished = find_finished_shards(folder, recipe)
        self.job = ShardJob(
            str(recipe_path.resolve()),
            str(folder.resolve()),
            digest,
            self._identity.environment,
        )
        require_space(folder, self._stage, recipe.num_samples - self.num_finished_samples)

    @property
    def missing(self) -> list[int]:
        """Numbers of the shards to be drawn."""
        done = {record.number for record in self._finished}
        return [n for n in range(self.recipe.num_shards) if n not in done]

    @property
    def num_finished_samples(self) -> int:
        """Samples of the shards of an earlier run."""
        return sum(record.num_samples for record in self._finished)

    def complete(self, draw: _DrawShards) -> None:
        """Draw the missing shards, then the files beside, and the manifest last.

        Raises:
            CatoptraError: A sample cannot be drawn, or a file not written.
        """
        recipe, records = self.recipe, [*self._finished]
        if self.missing:
            records += draw(self.job, self.missing)
        if len(records) != recipe.num_shards:
            raise CatoptraError(f"{len(records)} of {recipe.num_shards} shards were drawn")
        write_summaries(self.folder, self._stage)
        details = {
            "samples": recipe.num_samples,
            "seed": recipe.seed,
            "renderer": recipe.renderer,
            "channels": list(recipe.channels),
            "formats": list(recipe.formats),
            "compression": recipe.compression,
            "worlds": [world.name for world in recipe.worlds],
            "cameras": describe_cameras(self.folder, self._stage),
        }
        finish_folder(self.folder, self._identity, records, details)


class ProgressReport:
    """Counts samples and writes a line from time to time."""

    def __init__(
        self,
        name: str,
        num_samples: int,
        num_done: int,
        output: TextIO,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin to count.

        Args:
            name: Name of the data set.
            num_samples: Samples in all.
            num_done: Samples of shards that were finished before.
            output: Standard error, or a test's file.
            clock: Monotonic clock in seconds.
        """
        self._name = name
        self._num_samples = num_samples
        self._num_before = self._num_done = num_done
        self._output = output
        self._clock = clock
        self._is_terminal = output.isatty()
        self._start_s = self._last_s = clock()

    def count_samples(self, number: int) -> None:
        """Count more samples as done."""
        self._num_done += number
        now_s = self._clock()
        interval_s = _TERMINAL_INTERVAL_S if self._is_terminal else _LOG_INTERVAL_S
        if now_s - self._last_s >= interval_s:
            self._last_s = now_s
            self._write(self.describe())

    def uncount_samples(self, number: int) -> None:
        """Take back samples of a shard that has to be drawn anew."""
        self._num_done -= number

    def describe(self) -> str:
        """The line."""
        drawn = self._num_done - self._num_before
        elapsed_s = self._clock() - self._start_s
        counts = f"{self._name}: {self._num_done} of {self._num_samples} samples"
        if drawn <= 0 or elapsed_s <= 0.0:
            return counts
        rate = drawn / elapsed_s
        left_s = (self._num_samples - self._num_done) / rate
        return f"{counts}, {rate:.1f} a second, {_format_duration(left_s)} left"

    def _write(self, text: str) -> None:
        # On a terminal one line that changes; a log gets lines.
        self._output.write(f"\r\x1b[K{text}" if self._is_terminal else f"{text}\n")
        self._output.flush()

    def finish(self) -> None:
        """Write the last line."""
        self._write(self.describe())
        if self._is_terminal:
            self._output.write("\n")
            self._output.flush()


def _format_duration(seconds: float) -> str:
    """Duration as 12 s, 3 min 20 s or 2 h 05 min."""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
