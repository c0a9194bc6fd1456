"""Does any parser fail on what it may be given? Random and mutated bytes, a million cases.

Run: make fuzz, or, in tests/, `python -m conformance.fuzz --cases 1000000 --seed 1`. A case is one
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
from conformance.fuzz_parser import BrokenError, Parser

_PROGRESS_EVERY = 50_000


def parsers() -> list[Parser]:
    """Return all parsers; those that keep something keep it from case to case."""
    return [*fuzz_wire.parsers(), *fuzz_stream.parsers(), *fuzz_files.parsers()]


def fuzz(them: Sequence[Parser], cases: int, seed: int, report: Callable[[int], None]) -> None:
    """Feed the parsers in turn. An error that is none of theirs carries the case."""
    chance = random.Random(seed)
    for number, parser in enumerate(islice(_turns(them), cases)):
        data = parser.mutate(chance, parser.seeds)
        begin_s = time.perf_counter()
        try:
            is_accepted = parser.feed(data)
        except Exception as error:
            raise BrokenError(f"{parser.name}, case {number}, {data!r}") from error
        parser.seconds += time.perf_counter() - begin_s
        parser.accepted += is_accepted
        parser.refused += not is_accepted
        if (number + 1) % _PROGRESS_EVERY == 0:
            report(number + 1)


def _turns(them: Sequence[Parser]) -> Iterator[Parser]:
    """Yield the parsers in turn, for ever; some sit out most turns."""
    for turn in count():
        yield from (parser for parser in them if turn % parser.every == 0)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz and print; return the exit status."""
    options = argparse.ArgumentParser(description="Feed all parsers with garbage.")
    options.add_argument("--cases", type=int, default=1_000_000)
    options.add_argument("--seed", type=int, default=1)
    given = options.parse_args(arguments)
    them, begin_s = parsers(), time.perf_counter()

    def progress(done: int) -> None:
        print(f"{done} cases, {time.perf_counter() - begin_s:.0f} s", flush=True)

    with _silent_libraries():
        fuzz(them, given.cases, given.seed, progress)
    Console().print(table(them))
    print(f"{given.cases} cases, seed {given.seed}: no parser failed")
    return 0


@contextmanager
def _silent_libraries() -> Iterator[None]:
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


def table(them: Sequence[Parser]) -> Table:
    """Return what became of the cases of each parser."""
    shown = Table("parser", "cases", "accepted", "refused", "us a case")
    for one in them:
        cases = one.accepted + one.refused
        microseconds = f"{1e6 * one.seconds / max(cases, 1):.1f}"
        shown.add_row(one.name, str(cases), str(one.accepted), str(one.refused), microseconds)
    return shown


if __name__ == "__main__":
    sys.exit(main())
