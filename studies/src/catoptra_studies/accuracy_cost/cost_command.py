"""The command `catoptra-studies cost`: measure accuracy, cost and localization, write the report.

All results are in cost.json; `--report-only` writes report and plots of an existing one again.
"""

from __future__ import annotations

import argparse
import platform
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from catoptra_protocol.command_line import CommandParser, parse_count, parse_integer
from catoptra_server.config.known_names import find_configuration
from catoptra_server.runtime.memory import count_processors
from catoptra_studies.accuracy_cost.cost_plots import write_result_plots
from catoptra_studies.accuracy_cost.cost_report import format_cost_report, format_summary_table
from catoptra_studies.accuracy_cost.cost_results import read_cost_results, write_cost_results
from catoptra_studies.accuracy_cost.cost_study import (
    CostStudyConfig,
    measure_all_frame_rates,
    measure_rendering,
)
from catoptra_studies.accuracy_cost.localization_study import (
    measure_localization,
    select_key_levels,
)
from catoptra_studies.commands import (
    add_output,
    make_parser,
    open_progress,
    parse_size,
    parse_study,
    print_line,
)
from catoptra_studies.reports import replace_block


def main(arguments: Sequence[str]) -> int:
    """Run the study."""
    parsed = parse_study(_make_parser(), arguments)
    if not parsed.report_only:
        _measure(parsed)
    _write_report(parsed)
    print_line(f"report: {_report_path(parsed)}")
    return 0


def _measure(parsed: argparse.Namespace) -> None:
    config = _study_config(parsed)
    path = parsed.out / "cost.json"
    with open_progress() as progress:
        if parsed.frame_rates_only:
            rows = measure_all_frame_rates(config, progress)
            write_cost_results(replace(read_cost_results(path), frame_rates=rows), path)
            return
        results = measure_rendering(config, progress)
        # Written twice: half an hour of measuring must not be lost with a drive that fails.
        write_cost_results(results, path)
        if parsed.drives:
            levels = select_key_levels(results.levels)
            localization = measure_localization(config, levels, progress)
            write_cost_results(replace(results, localization=localization), path)


def _write_report(parsed: argparse.Namespace) -> None:
    # Read back rather than passed on, so that --report-only cannot differ from a full run.
    results = read_cost_results(parsed.out / "cost.json")
    write_result_plots(results, parsed.out)
    _report_path(parsed).write_text(format_cost_report(results), encoding="utf-8")
    summary = format_summary_table(results)
    print_line(summary)
    if parsed.page:
        replace_block(parsed.page, "cost", summary)
    if parsed.data:
        write_cost_results(results, parsed.data)


def _report_path(parsed: argparse.Namespace) -> Path:
    # Not the repository's COST.md by default: only `make cost UPDATE=yes` overwrites it.
    path: Path = parsed.report or parsed.out / "COST.md"
    return path


def _study_config(parsed: argparse.Namespace) -> CostStudyConfig:
    return CostStudyConfig(
        robot_file=parsed.robot,
        world_files=tuple(parsed.world),
        size_px=parsed.size,
        is_quick=parsed.quick,
        output_folder=parsed.out,
        date=time.strftime("%Y-%m-%d"),
        machine=describe_machine(parsed.machine),
        num_runs=parsed.runs,
        seed=parsed.seed,
    )


def describe_machine(remark: str = "") -> str:
    """Processor, Python and a remark, for tables of measurements."""
    processors = f"{count_processors()} processors ({_processor_name()})"
    machine = f"{platform.machine()} with {processors}, Python {platform.python_version()}"
    return f"{machine}, {remark}" if remark else machine


def _processor_name() -> str:
    """Name of the processor; platform.processor() gives none on Linux."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "of unknown name")


def _make_parser() -> CommandParser:
    parser = make_parser(
        "cost",
        "Measure what accuracy costs in time and gains in localization, from mirrors of 16 "
        "polygons to exact rays.",
    )
    add = parser.add_argument
    add("--robot", type=partial(find_configuration, "robots"), default="p2at_omni", metavar="FILE",
        help="robot ini with a mirror camera, or a bundled name")  # fmt: skip
    find_world = partial(find_configuration, "worlds")
    add("--world", type=find_world, nargs="+", metavar="FILE",
        default=[find_world(name) for name in ("four_legged_2006", "corridors_and_rooms")],
        help="world ini or name; frame rates are measured in all, all else in the first "
        "(default: four_legged_2006 corridors_and_rooms)")  # fmt: skip
    add("--size", type=parse_size, default=360, metavar="PX",
        help="pixels along the side of the square image")  # fmt: skip
    add("--quick", action="store_true", help="fewer levels and frames, one drive for each level")
    add("--drives", action=argparse.BooleanOptionalAction, default=True,
        help="drive robots to measure detection and localization")  # fmt: skip
    add("--runs", type=parse_count, default=10, metavar="N", help="drives for each key level")
    add(
        "--seed",
        type=parse_integer,
        default=0,
        metavar="N",
        help="seed of all random numbers of the drives",
    )
    add_output(parser, "out/cost", "folder for cost.json and plots")
    add("--report", type=Path, metavar="FILE", help="report to write (default: COST.md in DIR)")
    add("--page", type=Path, metavar="FILE", help="file whose block cost gets the short table")
    parser.read_too("--page", "--readme")
    add("--data", type=Path, metavar="FILE", help="copy of cost.json to write besides")
    add("--machine", default="", metavar="TEXT", help="remark about the machine for the report")
    add("--report-only", action="store_true", help="measure nothing: write the report of cost.json")
    add("--frame-rates-only", action="store_true",
        help="measure Figure 10 again, and keep all else of cost.json")  # fmt: skip
    return parser
