"""Does any parser fail on what it may be given? Random and mutated bytes, a million cases.

Run: make fuzz, or, in tests/, `python -m conformance.fuzz_parsers --cases 1000000 --seed 1`. A case is one
input to one parser. A parser may raise nothing but the errors that its docstring names; it may keep
no more than its limit. Prints a table; exits with 0 if all held.
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

from conformance import fuzz_files, fuzz_stream, fuzz_wire
from conformance.fuzz_target import FuzzFailureError, FuzzTarget

_PROGRESS_INTERVAL = 50_000


def all_targets() -> list[FuzzTarget]:
    """Return all parsers; those that keep something keep it from case to case."""
    return [*fuzz_wire.wire_targets(), *fuzz_stream.stream_targets(), *fuzz_files.file_targets()]


def fuzz(
    targets: Sequence[FuzzTarget], num_cases: int, seed: int, report: Callable[[int], None]
) -> None:
    """Feed the parsers in turn. An error that is none of theirs carries the case."""
    chance = random.Random(seed)
    for number, parser in enumerate(islice(_schedule(targets), num_cases)):
        data = parser.mutate(chance, parser.seeds)
        begin_s = time.perf_counter()
        try:
            is_accepted = parser.feed(data)
        except Exception as error:
            raise FuzzFailureError(f"{parser.name}, case {number}, {data!r}") from error
        parser.total_s += time.perf_counter() - begin_s
        parser.num_accepted += is_accepted
        parser.num_rejected += not is_accepted
        if (number + 1) % _PROGRESS_INTERVAL == 0:
            report(number + 1)


def _schedule(targets: Sequence[FuzzTarget]) -> Iterator[FuzzTarget]:
    """Yield the parsers in turn, for ever; some sit out most turns."""
    for turn in count():
        yield from (parser for parser in targets if turn % parser.period == 0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz and print; return the exit status."""
    options = argparse.ArgumentParser(description="Feed all parsers with garbage.")
    options.add_argument("--cases", type=int, default=1_000_000)
    options.add_argument("--seed", type=int, default=1)
    given = options.parse_args(arguments)
    them, begin_s = all_targets(), time.perf_counter()

    def progress(done: int) -> None:
        print(f"{done} cases, {time.perf_counter() - begin_s:.0f} s", flush=True)

    with _silence_image_libraries():
        fuzz(them, given.cases, given.seed, progress)
    Console().print(results_table(them))
    print(f"{given.cases} cases, seed {given.seed}: no parser failed")
    return 0


@contextmanager
def _silence_image_libraries() -> Iterator[None]:
    """Keep libjpeg and libpng from telling stderr what is wrong with each of their cases."""
    kept, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    sys.stderr.flush()
    os.dup2(nothing, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nothing)


def results_table(targets: Sequence[FuzzTarget]) -> Table:
    """Return what became of the cases of each parser."""
    shown = Table("parser", "cases", "accepted", "refused", "us a case")
    for one in targets:
        cases = one.num_accepted + one.num_rejected
        microseconds = f"{1e6 * one.total_s / max(cases, 1):.1f}"
        shown.add_row(
            one.name, str(cases), str(one.num_accepted), str(one.num_rejected), microseconds
        )
    return shown


if __name__ == "__main__":
    sys.exit(main())
