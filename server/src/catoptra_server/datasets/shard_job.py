"""The work of one shard, in any process: read the recipe, draw its samples, write the file.

A job is small and names files by path; a process keeps what the last job has loaded, so that its
next shards begin warm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.datasets.dataset_stage import DatasetStage, find_digest_error
from catoptra_server.datasets.drawing_environment import find_environment_error
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.datasets.sample import SampleDescriber
from catoptra_server.datasets.sample_files import encode_sample
from catoptra_server.datasets.sample_renderer import SampleRenderer
from catoptra_server.datasets.shard_writer import (
    OpenFile,
    ShardRecord,
    open_for_writing,
    write_shard,
)


class WorkerRefusedError(CatoptraError):
    """A worker has other code, libraries or files than the driver, or another processor."""


@dataclass(frozen=True, slots=True)
class ShardJob:
    """What all workers of a data set need; sent to processes and machines."""

    recipe_path: str
    """Recipe, at the same path on all machines."""
    folder: str
    """Folder of the data set, shared by all machines."""
    digest: str
    """Digest of recipe, worlds and cameras."""
    environment: Mapping[str, str]
    instruction_set: str


# Called with the index of each sample before it is drawn.
ReportSample = Callable[[int], None]


class ShardArtist:
    """A recipe, loaded, with warm renderers: draws its shards one after the other."""

    def __init__(self, stage: DatasetStage) -> None:
        self._recipe = stage.recipe
        self._describer = SampleDescriber(stage)
        self._renderer = SampleRenderer(stage)

    def draw_shard(
        self,
        folder: Path,
        number: int,
        report: ReportSample = lambda index: None,
        open_file: OpenFile = open_for_writing,
    ) -> ShardRecord:
        """Draw and write one shard.

        Raises:
            CatoptraError: A sample cannot be drawn, or the shard not written; names the sample.
        """
        return write_shard(folder, number, self._draw_samples(number, report), open_file)

    def _draw_samples(
        self, number: int, report: ReportSample
    ) -> Iterator[tuple[str, Mapping[str, bytes]]]:
        for index in self._recipe.shard_samples(number):
            report(index)
            key = self._recipe.sample_key(index)
            try:
                sample = self._renderer.render_sample(self._describer.describe_sample(index))
            except CatoptraError as error:
                raise CatoptraError(f"sample {key}: {error}") from error
            yield key, encode_sample(sample)

    def close(self) -> None:
        """Free the renderers."""
        self._renderer.close()


def start_artist(job: ShardJob) -> ShardArtist:
    """Artist for a job, after this process has been compared with the driver.

    Raises:
        WorkerRefusedError: This worker would draw other bytes.
        CatoptraError: The recipe, or a file of it, cannot be read.
    """
    fault = find_environment_error(job.environment, job.instruction_set)
    if fault:
        raise WorkerRefusedError(fault)
    stage = DatasetStage(read_recipe(Path(job.recipe_path)))
    fault = find_digest_error(stage, job.digest)
    if fault:
        raise WorkerRefusedError(fault)
    return ShardArtist(stage)
