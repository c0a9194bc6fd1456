"""The command `catoptra-server cost`: measure what accuracy costs, write cost.json and pictures.

What can be told without a program that uses the frames: everything up to the picture. The client's
`python -m catoptra_studies.experiment.cost` adds landmarks and localisation to cost.json; then this
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
from catoptra_studies.accuracy_cost.cost_plots import write_result_plots
from catoptra_studies.accuracy_cost.cost_report import format_cost_report, format_summary_table
from catoptra_studies.accuracy_cost.cost_results import read_cost_results, write_cost_results
from catoptra_studies.accuracy_cost.cost_study import CostStudyConfig, run_cost_study
from catoptra_studies.reports.marked_block import replace_block

EXIT_FAILURE = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, or tell what was measured; return 0, or 2 with a message if it could not be done."""
    parsed = _parser().parse_args(arguments)
    console = Console(stderr=True)
    try:
        parsed.output.mkdir(parents=True, exist_ok=True)
        if not parsed.tell:
            with _progress(console) as progress:
                write_cost_results(
                    run_cost_study(_study_config(parsed), progress), parsed.output / "cost.json"
                )
        _write_report(parsed)
    except (CatoptraError, OSError) as error:
        console.print(f"catoptra-server cost: {error}", style="red", markup=False, soft_wrap=True)
        return EXIT_FAILURE
    console.print(f"report: {_report_path(parsed)}", markup=False, highlight=False)
    return 0


def _write_report(parsed: argparse.Namespace) -> None:
    document = read_cost_results(parsed.output / "cost.json")
    write_result_plots(document, parsed.output)
    _report_path(parsed).write_text(format_cost_report(document), encoding="utf-8")
    if parsed.readme:
        replace_block(parsed.readme, "cost", format_summary_table(document))


def _report_path(parsed: argparse.Namespace) -> Path:
    chosen: Path = parsed.report or parsed.output / "COST.md"
    return chosen


def _study_config(parsed: argparse.Namespace) -> CostStudyConfig:
    return CostStudyConfig(
        robot_file=parsed.robot,
        world_files=tuple(parsed.world),
        size_px=parsed.size,
        is_quick=parsed.quick,
        output_folder=parsed.output,
        date=time.strftime("%Y-%m-%d"),
        machine=_machine_description(parsed.machine),
    )


def _machine_description(remark: str) -> str:
    processors = f"{len(os.sched_getaffinity(0))} processors ({_processor_name()})"
    told = f"{platform.machine()} with {processors}, Python {platform.python_version()}"
    return f"{told}, {remark}" if remark else told


def _processor_name() -> str:
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
    add(
        "--size",
        type=_image_size,
        default=360,
        metavar="N",
        help="of the square picture (default 360)",
    )
    add("--quick", action="store_true", help="fewer steps and frames: within a minute")
    add("--output", type=Path, default=Path("out/cost"), metavar="DIR",
        help="where cost.json and the pictures go (default out/cost)")  # fmt: skip
    add("--report", type=Path, metavar="FILE", help="default: COST.md in the output")
    add("--readme", type=Path, metavar="FILE", help="file whose cost block gets the short table")
    add("--machine", default="", metavar="WORDS", help="to be said of this machine in the report")
    add("--tell", action="store_true", help="measure nothing: tell what cost.json holds")
    return parser


def _image_size(text: str) -> int:
    size = int(text)
    if not 16 <= size <= 4096:
        raise argparse.ArgumentTypeError(f"a picture is 16 to 4096 px wide here, not {size}")
    return size
