"""Shards by processes: the same bytes by any number of them, and after deaths."""

from __future__ import annotations

import os
import signal
from multiprocessing import Pipe
from pathlib import Path

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.dataset_run import DatasetRun
from catoptra_server.datasets.local_workers import DatasetInterruptedError, LocalWorkers
from catoptra_server.datasets.shards import ShardJob
from helpers.dataset_recipes import RANDOMISED, write_drive, write_recipe
from helpers.long_cases import quick_cases


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> ShardJob:
    """Job of a drive of three shards."""
    folder = tmp_path_factory.mktemp("job")
    return DatasetRun(write_drive(folder, *RANDOMISED), folder / "out").job


def draw(job: ShardJob, workers: LocalWorkers) -> dict[int, str]:
    """Hashes of all shards, drawn anew."""
    return {record.number: record.sha256 for record in workers.draw([0, 1, 2])}


@pytest.fixture(scope="module")
def hashes(job: ShardJob) -> dict[int, str]:
    """Hashes by one worker."""
    return draw(job, LocalWorkers(job, 1))


@pytest.mark.parametrize("num_workers", quick_cases([2, 4], 0))
def test_bytes_do_not_depend_on_the_number_of_workers(
    job: ShardJob, hashes: dict[int, str], num_workers: int
) -> None:
    assert draw(job, LocalWorkers(job, num_workers)) == hashes


def test_shard_of_a_killed_worker_is_drawn_again(job: ShardJob, hashes: dict[int, str]) -> None:
    lost: list[int] = []
    killed: list[int] = []

    def count(number: int, is_begun: bool) -> None:
        if not is_begun:
            lost.append(number)
        elif not killed:
            killed.append(workers.pids[0])
            os.kill(killed[0], signal.SIGKILL)

    workers = LocalWorkers(job, 1, count=count)
    assert draw(job, workers) == hashes
    assert len(lost) == 1


def test_shard_whose_workers_all_die_is_an_error_that_names_the_sample(job: ShardJob) -> None:
    def count(number: int, is_begun: bool) -> None:
        if is_begun:
            for pid in workers.pids:
                os.kill(pid, signal.SIGKILL)

    workers = LocalWorkers(job, 1, count=count)
    with pytest.raises(
        CatoptraError, match=r"shard 0: 3 workers have ended .* sample [01]: ended by SIGKILL"
    ):
        list(workers.draw([0]))


def test_sample_that_cannot_be_drawn_is_an_error(tmp_path: Path) -> None:
    area = ("[Catoptra.RandomPoses]", "X=(Min=50,Max=51)", "Y=(Min=0,Max=1)", "MaxTries=3")
    bad = DatasetRun(write_recipe(tmp_path, *area), tmp_path / "out").job
    with pytest.raises(CatoptraError, match=r"sample 000000: .*no free pose"):
        list(LocalWorkers(bad, 1).draw([0, 1]))


def test_workers_that_refuse_are_an_error(job: ShardJob) -> None:
    other = ShardJob(job.recipe_path, job.folder, "0" * 64, job.environment)
    with pytest.raises(CatoptraError, match="differ from those of the driver"):
        list(LocalWorkers(other, 1).draw([0]))


def test_interruption_ends_the_workers(job: ShardJob) -> None:
    own, others = Pipe(duplex=False)
    pids: list[int] = []

    def count(number: int, is_begun: bool) -> None:
        pids.extend(workers.pids)
        others.send(None)

    workers = LocalWorkers(job, 2, count=count, interrupt=own)
    with pytest.raises(DatasetInterruptedError):
        list(workers.draw([0, 1, 2]))
    assert pids
    assert not workers.pids
