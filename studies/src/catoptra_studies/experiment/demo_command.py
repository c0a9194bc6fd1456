"""The command `catoptra-studies demo`: the paper's experiment in both set-ups, with a report.

Each set-up has a server process, or a running server given by address. Every seed is driven, the
camera's figures are drawn, and report.html, figures and summary.json are written.
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from catoptra_protocol.command_line import (
    EXIT_FAILURE,
    CommandParser,
    parse_count,
    parse_float_within,
    parse_integer,
)
from catoptra_studies.commands import (
    ProgressDisplay,
    add_output,
    make_parser,
    open_progress,
    parse_study,
    print_line,
    print_table,
)
from catoptra_studies.experiment.experiment_report import format_page_block
from catoptra_studies.experiment.experiment_results import write_experiment_results
from catoptra_studies.experiment.experiment_runner import (
    DetectorSnapshot,
    ExperimentConfig,
    SetupResult,
    parse_server_address,
    run_setup,
    train_classifier,
)
from catoptra_studies.experiment.experiment_setups import SETUPS, SIM
from catoptra_studies.experiment.figure_source import (
    FigureSource,
    capture_frame_comparison,
    collect_camera_figures,
    default_figure_source,
)
from catoptra_studies.reports import replace_block


def main(arguments: Sequence[str]) -> int:
    """Run the experiment; return 1 where a claim is refuted, otherwise 0."""
    parsed = parse_study(_make_parser(), arguments)
    config = _experiment_config(parsed)
    timing_s: dict[str, float] = {}
    results, snapshot = _run_drives(config, timing_s)
    with _measure_time("figures of the camera", timing_s):
        camera_figures = collect_camera_figures(config, FigureSource(parsed.figures))
        comparison = capture_frame_comparison(config)
    with _measure_time("report", timing_s):
        report, claims = write_experiment_results(
            config,
            results,
            camera_figures,
            snapshot=snapshot,
            comparison=comparison,
            timing_s=timing_s,
            subtitle=f"Run on {time.strftime('%Y-%m-%d')}, {platform.machine()}, "
            f"Python {platform.python_version()}, {config.num_runs} runs a set-up, "
            f"seed {config.seed}.",
        )
    rows = [(claim.text, str(claim.runs), claim.verdict) for claim in claims]
    print_table(("claim of the paper", "true in (95 % interval)", "confirmed"), rows)
    print_line(f"report: {report}")
    if parsed.page:
        summary = json.loads((parsed.out / "summary.json").read_text("utf-8"))
        replace_block(parsed.page, "demo", format_page_block(summary))
    return EXIT_FAILURE if any(claim.is_refuted for claim in claims) else 0


def _run_drives(
    config: ExperimentConfig, timing_s: dict[str, float]
) -> tuple[list[SetupResult], DetectorSnapshot | None]:
    """Train and drive, with a progress bar for each task."""
    for name, address in config.remote_servers.items():
        print_line(f"{name}: server at {address.host}:{address.control_port}")
    with open_progress() as progress:
        on_step = {
            setup.name: progress.add_task(
                f"{setup.name}: steps", config.num_runs * len(setup.route)
            )
            for setup in config.setups
        }
        on_frame = progress.add_task("train: labelled frames", config.num_training_frames)
        classifier, snapshot = None, None
        if SIM in config.setups:
            with _measure_time("training", timing_s):
                classifier, snapshot = train_classifier(config, on_frame=on_frame)
        results = []
        # One after the other: their servers would share the processors and the timing mean little.
        for setup in config.setups:
            with _measure_time(f"{setup.name} drives", timing_s):
                results.append(
                    run_setup(
                        config,
                        setup,
                        classifier,
                        on_step=on_step[setup.name],
                        on_page=partial(_print_page, progress, setup.name),
                    )
                )
        return results, snapshot


def _print_page(progress: ProgressDisplay, setup: str, link: str) -> None:
    progress.print_line(f"{setup}: watch the drives at {link}")


@contextmanager
def _measure_time(name: str, timing_s: dict[str, float]) -> Iterator[None]:
    begin_s = time.monotonic()
    yield
    timing_s[name] = time.monotonic() - begin_s


def _make_parser() -> CommandParser:
    parser = make_parser(
        "demo",
        "Repeat the paper's experiment: drive both set-ups, localize by landmarks, and "
        "compare the results with the paper's claims.",
    )
    add = parser.add_argument
    add("--configs", type=Path, metavar="DIR",
        help="folder with robots/, worlds/ and landmarks/ (default: bundled files)")  # fmt: skip
    add_output(parser, "out/demo", "folder for report, figures and summary.json")
    add("--setup", choices=["sim", "real", "both"], default="both", help="set-ups to drive")
    add("--runs", type=parse_count, default=20, metavar="N", help="drives for each set-up")
    add("--seed", type=parse_integer, default=0, metavar="N", help="seed of all random numbers")
    add("--training-frames", type=parse_count, default=30, metavar="N",
        help="frames for the classifier")  # fmt: skip
    add("--renderer", choices=["auto", "trace", "raster"], default="auto",
        help="renderer of the servers that are started")  # fmt: skip
    add("--server", type=parse_server_address, action="append", default=[],
        metavar="SETUP=HOST[:CONTROL[:IMAGE]]",
        help="running lockstep server for a set-up, not a process; may be repeated")  # fmt: skip
    add("--figures", choices=[source.value for source in FigureSource],
        default=default_figure_source().value,
        help="figures of the camera: drawn here by the installed server's code, by an external "
        "program into DIR, or none (default: local where the server is installed)")  # fmt: skip
    add("--page", type=Path, metavar="FILE", help="file whose block demo gets the table of errors")
    add("--timeout", type=partial(parse_float_within, name="a time-out"), default=60.0, metavar="S",
        help="longest wait for a running server or for external figures, in seconds")  # fmt: skip
    return parser


def _experiment_config(parsed: argparse.Namespace) -> ExperimentConfig:
    return ExperimentConfig(
        config_folder=parsed.configs,
        output_folder=parsed.out,
        setups=tuple(setup for setup in SETUPS if parsed.setup in (setup.name, "both")),
        num_runs=parsed.runs,
        seed=parsed.seed,
        num_training_frames=parsed.training_frames,
        server_arguments=("--renderer", parsed.renderer),
        remote_servers=dict(parsed.server),
        timeout_s=parsed.timeout,
    )
