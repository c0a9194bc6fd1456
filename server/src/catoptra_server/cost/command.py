"""The command `catoptra-server cost`: measure what accuracy costs, write cost.json and pictures.

What can be told without a program that uses the frames: everything up to the picture. The client's
`python -m catoptra_client.experiment.cost` adds landmarks and localisation to cost.json; then this
command with --tell writes the report and the pictures of numbers anew, and measures nothing.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from catoptra_protocol.errors import CatoptraError
from catoptra_server.cost.document import read_document, write_document
from catoptra_server.cost.marked_block import write_block
from catoptra_server.cost.report import report, short_table
from catoptra_server.cost.study import Order, measure
from catoptra_server.cost.telling import draw_numbers

EXIT_CANNOT_MEASURE = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, or tell what was measured; return 0, or 2 with a message if it could not be done."""
    parsed = _parser().parse_args(arguments)
    console = Console(stderr=True)
    try:
        parsed.output.mkdir(parents=True, exist_ok=True)
        if not parsed.tell:
            with _progress(console) as progress:
                write_document(measure(_order(parsed), progress), parsed.output / "cost.json")
        _tell(parsed)
    except (CatoptraError, OSError) as error:
        console.print(f"catoptra-server cost: {error}", style="red", markup=False, soft_wrap=True)
        return EXIT_CANNOT_MEASURE
    console.print(f"report: {_report_path(parsed)}", markup=False, highlight=False)
    return 0


def _tell(parsed: argparse.Namespace) -> None:
    document = read_document(parsed.output / "cost.json")
    draw_numbers(document, parsed.output)
    _report_path(parsed).write_text(report(document), encoding="utf-8")
    if parsed.readme:
        write_block(parsed.readme, "cost", short_table(document))


def _report_path(parsed: argparse.Namespace) -> Path:
    chosen: Path = parsed.report or parsed.output / "COST.md"
    return chosen


def _order(parsed: argparse.Namespace) -> Order:
    return Order(
        robot=parsed.robot,
        worlds=tuple(parsed.world),
        size_px=parsed.size,
        is_quick=parsed.quick,
        output=parsed.output,
        date=time.strftime("%Y-%m-%d"),
        machine=_machine(parsed.machine),
    )


def _machine(said: str) -> str:
    processors = f"{len(os.sched_getaffinity(0))} processors ({_processor()})"
    told = f"{platform.machine()} with {processors}, Python {platform.python_version()}"
    return f"{told}, {said}" if said else told


def _processor() -> str:
    """Return the processor's name, as Linux tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "of unknown name")


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description:<28}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="catoptra-server cost",
        description="Measure what accuracy costs in time, from 16 polygons to exact rays.",
    )
    add = parser.add_argument
    add("--robot", type=Path, required=True, metavar="FILE", help="robot ini with a mirror camera")
    add("--world", type=Path, required=True, action="append", metavar="FILE",
        help="world ini; frame rates are measured in all given, all else in the first")  # fmt: skip
    add("--size", type=_size, default=360, metavar="N", help="of the square picture (default 360)")
    add("--quick", action="store_true", help="fewer steps and frames: within a minute")
    add("--output", type=Path, default=Path("out/cost"), metavar="DIR",
        help="where cost.json and the pictures go (default out/cost)")  # fmt: skip
    add("--report", type=Path, metavar="FILE", help="default: COST.md in the output")
    add("--readme", type=Path, metavar="FILE", help="file whose cost block gets the short table")
    add("--machine", default="", metavar="WORDS", help="to be said of this machine in the report")
    add("--tell", action="store_true", help="measure nothing: tell what cost.json holds")
    return parser


def _size(text: str) -> int:
    size = int(text)
    if not 16 <= size <= 4096:
        raise argparse.ArgumentTypeError(f"a picture is 16 to 4096 px wide here, not {size}")
    return size
