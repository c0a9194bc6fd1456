"""Shards drawn by Ray, on this machine or on a cluster: a task for each shard.

Ray starts the workers, spreads the tasks and repeats the tasks of lost machines: no scheduler
is ours. Recipe and folder are at the same paths on all machines. A worker whose code or libraries
differ refuses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from catoptra_protocol.errors import CatoptraError
from catoptra_server.datasets.local_workers import DatasetInterruptedError
from catoptra_server.datasets.shards import ShardArtist, ShardJob, ShardRecord, start_artist

_LOCAL = "local"
"""Address of a cluster that is started on this machine, for this run."""
_REMEDY = "pip install 'catoptra-server[ray]' on all machines, or draw with --workers"
# Times that Ray repeats a shard whose worker or machine is lost.
_MAX_RETRIES = 3
# Tasks known to Ray at a time, for each processor: enough that none waits for the driver.
_TASKS_A_PROCESSOR = 4
# A part of the time that the process has to end after a signal.
_INTERRUPT_INTERVAL_S = 0.1
# Called with the number of samples of each finished shard.
_CountShard = Callable[[int], None]


def require_ray() -> Any:
    """The module `ray`.

    Raises:
        CatoptraError: Ray is not installed; says how to.
    """
    try:
        import ray
    except ImportError as error:
        raise CatoptraError(f"--ray needs the package ray: {_REMEDY}") from error
    return ray


def draw_by_ray(
    job: ShardJob,
    shards: Sequence[int],
    address: str,
    *,
    count: _CountShard = lambda number: None,
    interrupt: Connection | None = None,
) -> Iterator[ShardRecord]:
    """Draw shards, and yield the record of each when finished, in any order.

    Args:
        job: The data set.
        shards: Numbers of the shards.
        address: LOCAL, or the address of a cluster as for `ray.init`.
        count: Called for each shard.
        interrupt: Readable once the user wants an end.

    Raises:
        DatasetInterruptedError: The user wants an end.
        CatoptraError: Ray is missing or not reached, a worker refuses, a sample cannot be drawn, or
            the workers of a shard are lost too often.
    """
    ray = require_ray()
    _connect(ray, address)
    try:
        yield from _draw_tasks(ray, job, shards, count, interrupt)
    finally:
        ray.shutdown()


def _connect(ray: Any, address: str) -> None:
    try:
        ray.init(
            address=None if address == _LOCAL else address,
            include_dashboard=False if address == _LOCAL else None,
            configure_logging=False,
            log_to_driver=False,
        )
    # Whatever is wrong with an address: Ray raises any of these.
    except (ConnectionError, ValueError, RuntimeError, OSError) as error:
        raise CatoptraError(f"no Ray cluster at {address}: {error}") from error


def _draw_tasks(
    ray: Any,
    job: ShardJob,
    shards: Sequence[int],
    count: _CountShard,
    interrupt: Connection | None,
) -> Iterator[ShardRecord]:
    task = ray.remote(num_cpus=1, max_retries=_MAX_RETRIES)(draw_shard_of_job)
    # A bounded number at a time: the driver's memory does not grow with the data set.
    max_tasks = max(1, _TASKS_A_PROCESSOR * int(ray.cluster_resources().get("CPU", 1)))
    waiting, pending = iter(shards), dict[Any, int]()
    while True:
        for number in waiting:
            pending[task.remote(job, number)] = number
            if len(pending) >= max_tasks:
                break
        if not pending:
            return
        finished, _ = ray.wait([*pending], num_returns=1, timeout=_INTERRUPT_INTERVAL_S)
        if interrupt is not None and interrupt.poll():
            raise DatasetInterruptedError("interrupted")
        for done in finished:
            record = _take_result(ray, done, pending.pop(done))
            count(record.num_samples)
            yield record


def _take_result(ray: Any, done: Any, number: int) -> ShardRecord:
    try:
        record: ShardRecord | str = ray.get(done)
    except ray.exceptions.RayError as error:
        # Of several lines the first names the fault.
        reason = str(error).strip().splitlines()[0]
        raise CatoptraError(f"shard {number}: its Ray workers are lost: {reason}") from error
    if isinstance(record, str):
        raise CatoptraError(record)
    return record


def draw_shard_of_job(job: ShardJob, number: int) -> ShardRecord | str:
    """Draw one shard in a Ray worker; its record, or the reason for which that is impossible."""
    # A text and no exception: what fails by the recipe fails again on any machine, and Ray repeats
    # the tasks of lost workers alone.
    try:
        return _find_artist(job).draw_shard(Path(job.folder), number)
    except CatoptraError as error:
        return str(error)


# Ray keeps worker processes between tasks: the artist of the last job, with warm renderers.
_artists: dict[tuple[str, str], ShardArtist] = {}


def _find_artist(job: ShardJob) -> ShardArtist:
    """Artist of a job in this process, started at the first shard."""
    key = (job.recipe_path, job.digest)
    if key not in _artists:
        artist = start_artist(job)
        while _artists:
            _artists.popitem()[1].close()
        _artists[key] = artist
    return _artists[key]
