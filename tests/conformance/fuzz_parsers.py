"""Fuzzing of all parsers with random and mutated bytes, a million cases.

Run: make fuzz, or, in tests/, `python -m conformance.fuzz_parsers --cases 1000000 --seed 1`. A case
is one input to one parser. A parser may raise only the errors that its docstring names, and must
stay within its memory limit. Prints a table; exits with 0 if no parser failed.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import count, islice

from rich.console import Console
from rich.table import Table

from conformance import fuzz_calibration, fuzz_files, fuzz_stream, fuzz_usarsim
from conformance.fuzz_target import FuzzFailureError, FuzzTarget

_PROGRESS_INTERVAL = 50_000


def all_targets() -> list[FuzzTarget]:
    """All parsers; those with a buffer keep their state from case to case."""
    return [
        *fuzz_usarsim.usarsim_targets(),
        *fuzz_stream.stream_targets(),
        *fuzz_files.file_targets(),
        *fuzz_calibration.calibration_targets(),
    ]


def fuzz(
    targets: Sequence[FuzzTarget], num_cases: int, seed: int, report: Callable[[int], None]
) -> None:
    """Feed the parsers in turn.

    Args:
        targets: Parsers; their tallies are updated.
        num_cases: Number of inputs in total.
        seed: Seed of the mutations.
        report: Called with the number of completed cases.

    Raises:
        FuzzFailureError: A parser raised an error outside its contract; quotes the input.
    """
    rng = random.Random(seed)
    for number, target in enumerate(islice(_schedule(targets), num_cases)):
        data = target.mutate(rng, target.seeds)
        begin_s = time.perf_counter()
        try:
            is_accepted = target.feed(data)
        except Exception as error:
            raise FuzzFailureError(f"{target.name}, case {number}, {data!r}") from error
        target.total_s += time.perf_counter() - begin_s
        target.num_accepted += is_accepted
        target.num_rejected += not is_accepted
        if (number + 1) % _PROGRESS_INTERVAL == 0:
            report(number + 1)


def _schedule(targets: Sequence[FuzzTarget]) -> Iterator[FuzzTarget]:
    """Iterate over the parsers in turn, for ever; a slow parser skips most turns."""
    for turn in count():
        yield from (target for target in targets if turn % target.period == 0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz and print the table; exit status."""
    parser = argparse.ArgumentParser(description="Feed all parsers malformed input.")
    parser.add_argument("--cases", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(arguments)
    targets, begin_s = all_targets(), time.perf_counter()

    def progress(done: int) -> None:
        print(f"{done} cases, {time.perf_counter() - begin_s:.0f} s", flush=True)

    with _silence_image_libraries():
        fuzz(targets, options.cases, options.seed, progress)
    Console().print(results_table(targets))
    print(f"{options.cases} cases, seed {options.seed}: no parser failed")
    return 0


@contextmanager
def _silence_image_libraries() -> Iterator[None]:
    """Redirect file descriptor 2: libjpeg and libpng report each malformed input to stderr."""
    saved, null = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    # The libraries write from C, so sys.stderr alone would not silence them.
    sys.stderr.flush()
    os.dup2(null, 2)
    try:
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(null)


def results_table(targets: Sequence[FuzzTarget]) -> Table:
    """Tally of each parser."""
    table = Table("parser", "cases", "accepted", "rejected", "us per case")
    for target in targets:
        cases = target.num_accepted + target.num_rejected
        microseconds = f"{1e6 * target.total_s / max(cases, 1):.1f}"
        counts = (cases, target.num_accepted, target.num_rejected)
        table.add_row(target.name, *map(str, counts), microseconds)
    return table


if __name__ == "__main__":
    sys.exit(main())
