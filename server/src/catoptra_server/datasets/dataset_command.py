"""`catoptra-server dataset`: draw a data set by a recipe, or verify one."""

from __future__ import annotations

import argparse
import multiprocessing
import multiprocessing.connection
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from catoptra_protocol.command_line import CommandParser, int_within
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.interrupts import EXIT_INTERRUPTED
from catoptra_protocol.names import list_names
from catoptra_server.config.known_names import bundled_files, find_configuration
from catoptra_server.datasets.dataset_folder import verify_dataset
from catoptra_server.datasets.dataset_run import (
    DatasetRun,
    ProgressReport,
)
from catoptra_server.datasets.local_workers import DatasetInterruptedError, LocalWorkers
from catoptra_server.datasets.pictures import NUM_SAMPLES, SHEET_NAME, write_sheet
from catoptra_server.datasets.ray_workers import draw_by_ray, require_ray
from catoptra_server.datasets.shards import ShardJob, ShardRecord, remove_parts
from catoptra_server.runtime.faults import Termination
from catoptra_server.runtime.memory import count_processors

_MAX_WORKERS = 1024


def main(arguments: Sequence[str], termination: Termination) -> int:
    """Run the command.

    Args:
        arguments: Words after `dataset`.
        termination: Signals that end the process.

    Returns:
        Exit status.
    """
    parser = _build_parser()
    parsed = parser.parse_args(arguments)
    if not parsed.recipe and not (parsed.verify or parsed.sheet):
        names = list_names("", (path.stem for path in bundled_files("datasets")))
        parser.error(f"which RECIPE? A file, or one of the bundled ones: {names}")
    own, others = multiprocessing.Pipe(duplex=False)
    # The first signal ends the workers in order; unfinished files of shards are removed.
    with termination.call_on_signal(
        lambda: others.send(None), flush=lambda: None, note="the same command goes on"
    ):
        try:
            return _run(parsed, own)
        except DatasetInterruptedError:
            return EXIT_INTERRUPTED


def _build_parser() -> CommandParser:
    parser = CommandParser(
        "catoptra-server dataset",
        "Draw pictures with ground truth by a recipe: sample i depends on the recipe "
        "and i alone. An interrupted run goes on by the same command.",
    )
    add = parser.add_argument
    add("recipe", nargs="?", type=partial(find_configuration, "datasets"), metavar="RECIPE",
        help="recipe file, or a bundled one's name; not needed to read back")  # fmt: skip
    add("--out", required=True, type=Path, metavar="DIR", help="folder, made if absent")
    add("--workers", type=int_within("a number of workers", 1, _MAX_WORKERS), metavar="N",
        default=count_processors(),
        help="processes of one thread each (default: one for each processor)")  # fmt: skip
    add("--ray", default="", metavar="local|ADDRESS",
        help="draw by Ray: on this machine, or on the cluster of an address")  # fmt: skip
    add("--verify", action="store_true",
        help="read back every shard, and compare its hash")  # fmt: skip
    add("--sheet", action="store_true",
        help=f"write {SHEET_NAME}: {NUM_SAMPLES} samples with all channels")  # fmt: skip
    return parser


def _run(parsed: argparse.Namespace, interrupt: multiprocessing.connection.Connection) -> int:
    if not parsed.recipe:
        _read_back(parsed)
        return 0
    if parsed.ray:
        require_ray()
    run = DatasetRun(parsed.recipe, parsed.out)
    recipe = run.recipe
    if not run.is_whole or run.missing:
        progress = ProgressReport(
            recipe.name, recipe.num_samples, run.num_finished_samples, sys.stderr
        )
        try:
            run.complete(lambda job, shards: _draw(parsed, job, shards, progress, interrupt))
        except CatoptraError:
            remove_parts(run.folder)
            raise
        progress.finish()
    print(f"{run.folder}: {recipe.num_samples} samples in {recipe.num_shards} shards")
    _read_back(parsed)
    return 0


def _draw(
    parsed: argparse.Namespace,
    job: ShardJob,
    shards: Sequence[int],
    progress: ProgressReport,
    interrupt: multiprocessing.connection.Connection,
) -> Iterator[ShardRecord]:
    if parsed.ray:
        yield from draw_by_ray(
            job, shards, parsed.ray, count=progress.count_samples, interrupt=interrupt
        )
        return

    def count(number: int, is_begun: bool) -> None:
        if is_begun:
            progress.count_samples(1)
        else:
            progress.uncount_samples(number)

    workers = LocalWorkers(job, parsed.workers, count=count, interrupt=interrupt)
    yield from workers.draw(shards)


def _read_back(parsed: argparse.Namespace) -> None:
    """Do what is asked for with a whole data set."""
    if parsed.verify:
        for line in verify_dataset(parsed.out):
            print(line)
    if parsed.sheet:
        print(write_sheet(parsed.out))
