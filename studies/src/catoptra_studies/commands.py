"""What the commands of all studies share: their parser, progress bars and messages.

A command parses its options, makes the folder of `--out`, and runs. Results go to stdout; bars and
errors go to stderr, so that output can be piped. This is the only module that imports Rich.
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

from catoptra_protocol.command_line import CommandParser, int_within

parse_size = int_within("a size", 16, 4096)


def make_parser(name: str, description: str) -> CommandParser:
    """Parser of the options of `catoptra-studies <name>`."""
    return CommandParser(f"catoptra-studies {name}", description)


def add_output(parser: CommandParser, folder: str, content: str) -> None:
    """Declare `--out`, the folder that `parse_study` makes."""
    parser.add_argument("--out", type=Path, default=Path(folder), metavar="DIR", help=content)
    parser.read_too("--out", "--output")


def parse_study(parser: CommandParser, arguments: Sequence[str]) -> argparse.Namespace:
    """Options of a study, for which the folder of `--out` is made."""
    parsed = parser.parse_args(arguments)
    parsed.out.mkdir(parents=True, exist_ok=True)
    return parsed


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
        try:
            yield ProgressDisplay(progress)
        except KeyboardInterrupt:
            # A pipe gets the bars at the end alone: after Ctrl-C it gets one line.
            progress.console.quiet = not progress.console.is_terminal
            raise


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
