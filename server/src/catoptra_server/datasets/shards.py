"""Shards as tar files, written whole or not at all, and the work of one shard in any process.

A shard gets its name when every byte is on disk: before, the process writes a file with another
ending, which no reader takes for a shard. The record beside a shard holds the hash. A job is
small and names files by path; a process keeps what the last job has loaded, so that the next shards
begin warm.
"""

from __future__ import annotations

import errno
import json
import os
import platform
import tarfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.shards import hash_file, shard_name
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.datasets.dataset_stage import DatasetStage
from catoptra_server.datasets.recipe_file import read_recipe
from catoptra_server.datasets.sample import SampleDescriber, encode_sample
from catoptra_server.datasets.sample_renderer import SampleRenderer
from catoptra_server.datasets.worker_environment import require_environment

_PART_SUFFIX = ".part"
"""Ending of files that are not whole."""
# Called with the index of each sample before the drawing.
_ReportSample = Callable[[int], None]


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


@dataclass(frozen=True, slots=True)
class ShardRecord:
    """A whole shard, as in the record beside the shard and in the manifest."""

    number: int
    sha256: str
    num_bytes: int
    num_samples: int

    @property
    def path(self) -> str:
        """Path in the data set's folder."""
        return shard_name(self.number)

    def to_json(self) -> dict[str, int | str]:
        """Entry of the manifest."""
        return {
            "path": self.path,
            "sha256": self.sha256,
            "bytes": self.num_bytes,
            "samples": self.num_samples,
        }


def start_artist(job: ShardJob) -> ShardArtist:
    """Artist for a job, after this process has been compared with the driver.

    Raises:
        WorkerRefusedError: This worker would draw other bytes.
        CatoptraError: The recipe, or a file in the recipe, cannot be read.
    """
    require_environment(job.environment)
    stage = DatasetStage(read_recipe(Path(job.recipe_path)))
    stage.require_digest(job.digest)
    return ShardArtist(stage)


class ShardArtist:
    """A recipe, loaded, with warm renderers: draws shards one after the other."""

    def __init__(self, stage: DatasetStage) -> None:
        self._recipe = stage.recipe
        self._describer = SampleDescriber(stage)
        self._renderer = SampleRenderer(stage)

    def draw_shard(
        self,
        folder: Path,
        number: int,
        report: _ReportSample = lambda index: None,
    ) -> ShardRecord:
        """Draw and write one shard.

        Raises:
            CatoptraError: A sample cannot be drawn, or the shard not written; names the sample.
        """
        return write_shard(folder, number, self._draw_samples(number, report))

    def _draw_samples(
        self, number: int, report: _ReportSample
    ) -> Iterator[tuple[str, Mapping[str, bytes]]]:
        for index in self._recipe.shard_samples(number):
            report(index)
            key = self._recipe.sample_key(index)
            try:
                sample = self._renderer.render_sample(self._describer.describe_sample(index))
            except CatoptraError as error:
                raise CatoptraError(f"sample {key}: {error}") from error
            yield key, encode_sample(sample, self._recipe.compression)

    def close(self) -> None:
        """Free the renderers."""
        self._renderer.close()


def write_shard(
    folder: Path,
    number: int,
    samples: Iterable[tuple[str, Mapping[str, bytes]]],
) -> ShardRecord:
    """Write a shard and the record.

    Args:
        folder: Folder of the data set.
        number: Number of the shard.
        samples: Name and files of each sample, in order; drawn one by one during the writing.

    Raises:
        CatoptraError: The disk is full, or a file cannot be written.
    """
    path, count = folder / shard_name(number), 0

    def pieces() -> Iterable[bytes]:
        nonlocal count
        for key, files in samples:
            for suffix, content in files.items():
                yield _member(f"{key}.{suffix}", content)
            count += 1
        # Two empty blocks end an archive.
        yield bytes(2 * tarfile.BLOCKSIZE)

    write_whole(path, pieces())
    record = ShardRecord(number, hash_file(path), path.stat().st_size, count)
    write_whole(_record_path(folder, number), [json.dumps(record.to_json()).encode()])
    return record


def _member(name: str, content: bytes) -> bytes:
    """Header and blocks of one file, the same on every machine and at any time."""
    info = tarfile.TarInfo(name)
    info.size, info.mode, info.mtime = len(content), 0o644, 0
    header = info.tobuf(tarfile.USTAR_FORMAT)
    return b"".join((header, content, bytes(-len(content) % tarfile.BLOCKSIZE)))


def _record_path(folder: Path, number: int) -> Path:
    """File beside a whole shard, with the hash."""
    return (folder / shard_name(number)).with_suffix(".json")


def read_record(folder: Path, number: int) -> ShardRecord | None:
    """Record of a whole shard whose bytes still have the same hash; None to draw anew."""
    try:
        content = json.loads(_record_path(folder, number).read_text(encoding="utf-8"))
        record = ShardRecord(number, content["sha256"], content["bytes"], content["samples"])
        is_whole = hash_file(folder / shard_name(number)) == record.sha256
    except (OSError, ValueError, KeyError, TypeError, CatoptraError):
        return None
    return record if is_whole else None


def write_whole(path: Path, parts: Iterable[bytes]) -> None:
    """Write a file that appears under its name once whole and on disk.

    Args:
        path: The file; an older one is replaced.
        parts: Content, piece by piece.

    Raises:
        CatoptraError: The disk is full, or the file cannot be written.
    """
    # Of this process alone: another worker may write the same shard, with the same bytes.
    part = path.with_name(f"{path.name}.{platform.node()}.{os.getpid()}{_PART_SUFFIX}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.unlink(missing_ok=True)
        with part.open("xb") as file:
            for piece in parts:
                file.write(piece)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        raise CatoptraError(_describe(path, error)) from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def write_plain(path: Path, content: bytes) -> None:
    """Write a small file of many, on disk at some time after: for folders that a manifest ends.

    Raises:
        CatoptraError: The disk is full, or the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    except OSError as error:
        raise CatoptraError(_describe(path, error)) from error


def _describe(path: Path, error: OSError) -> str:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return (
            f"the disk is full: {path} was not written. Finished shards are kept: free space, and "
            "run the same command again"
        )
    return f"{path} cannot be written: {error.strerror or error}"


def _sync_folder(folder: Path) -> None:
    """Put a rename on disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def remove_parts(folder: Path) -> None:
    """Remove files that an interrupted run has left unfinished."""
    for part in folder.rglob(f"*{_PART_SUFFIX}"):
        part.unlink(missing_ok=True)
