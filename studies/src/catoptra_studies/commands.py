"""What the commands of all studies share: their parser, their end, progress bars and messages.

A command parses its options, makes the folder of `--output`, runs, and ends with one line about the
reason where the study could not be done. Results go to stdout; bars and errors go to stderr, so
that output can be piped. This is the only module that imports Rich.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from catoptra_protocol.errors import CatoptraError

EXIT_FAILURE = 2


def make_parser(name: str, description: str) -> argparse.ArgumentParser:
    """Parser of the options of `catoptra-studies <name>`."""
    return argparse.ArgumentParser(prog=f"catoptra-studies {name}", description=description)


def add_output(parser: argparse.ArgumentParser, folder: str, content: str) -> None:
    """Declare `--output`, the folder that `run_study` makes."""
    parser.add_argument(
        "--output", type=Path, default=Path(folder), metavar="DIR",
        help=f"{content} (default {folder})",
    )  # fmt: skip


def run_study(
    name: str,
    parsed: argparse.Namespace,
    run: Callable[[argparse.Namespace], int],
    *,
    exit_failure: int = EXIT_FAILURE,
) -> int:
    """Make the folder of `--output` and run a study.

    Args:
        name: First word of the line about a failure.
        parsed: Options, among them `output`.
        run: Runs the study and returns the exit status.
        exit_failure: Status of a study that could not be done.

    Returns:
        The exit status of the command.
    """
    try:
        parsed.output.mkdir(parents=True, exist_ok=True)
        return run(parsed)
    except (CatoptraError, OSError) as error:
        _print_plain(Console(stderr=True), f"{name}: {error}", style="red")
        return exit_failure


@dataclass(frozen=True, slots=True)
class ProgressDisplay:
    """Bars of the tasks of one study."""

    _progress: Progress

    def add_task(self, title: str, num_steps: int) -> Callable[[], None]:
        """Show a bar; the returned function advances the bar by one step, from any thread."""
        task = self._progress.add_task(title, total=num_steps)
        return partial(self._progress.advance, task)

    def print_line(self, text: str) -> None:
        """Print one line above the bars, from any thread."""
        _print_plain(self._progress.console, text)


@contextmanager
def open_progress(*, is_visible: bool = True) -> Iterator[ProgressDisplay]:
    """Show bars on stderr until the block ends."""
    columns = (
        # As wide as the longest title, so that bars do not jump when a task is added.
        TextColumn("{task.description:<34}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    # A hidden display advances like a visible one, so tests take the same path.
    with Progress(*columns, console=Console(stderr=True), disable=not is_visible) as progress:
        yield ProgressDisplay(progress)


def print_line(text: str) -> None:
    """Print one line of results."""
    _print_plain(Console(), text)


def print_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table whose last column says yes, no, or why neither.

    Args:
        header: Titles of the columns.
        rows: Cells of each row.
    """
    table = Table(*header)
    for *cells, answer in rows:
        colour = {"yes": "green", "no": "red"}.get(answer, "yellow")
        table.add_row(*cells, f"[{colour}]{answer}")
    Console().print(table)


def _print_plain(console: Console, text: str, *, style: str | None = None) -> None:
    # Paths and captions hold brackets, which Rich would read as its own markup.
    console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)
