"""`python -m catoptra_studies.experiment`: the paper's experiment in both set-ups, with its report.

Starts a server process for each set-up, or uses one that runs elsewhere, drives every seed, has the
camera's pictures drawn, writes report.html, its pictures and summary.json. Only this module of the
experiment prints.
"""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from catoptra_client.server_address import ServerAddress
from catoptra_protocol.errors import CatoptraError
from catoptra_studies.experiment.figure_source import FigureSource, collect_camera_figures
from catoptra_studies.experiment.experiment_results import write_experiment_results
from catoptra_studies.experiment.experiment_runner import (
    DetectorSnapshot,
    ExperimentConfig,
    SetupResult,
    run_setup,
    train_classifier,
)
from catoptra_studies.experiment.experiment_setups import SETUPS, SIM
from catoptra_studies.experiment.remote_server import parse_server_address


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the experiment; 0 = done and every claim holds, 1 = it failed or one does not."""
    parsed = _parser().parse_args(arguments)
    plan = _experiment_config(parsed)
    console = Console()
    try:
        plan.output_folder.mkdir(parents=True, exist_ok=True)
        return _run(plan, FigureSource(parsed.pictures), console)
    except (CatoptraError, OSError) as error:
        Console(stderr=True).print(
            f"experiment: {error}", style="red", markup=False, soft_wrap=True
        )
        return 1


def _run(config: ExperimentConfig, figure_source: FigureSource, console: Console) -> int:
    timing: dict[str, float] = {}
    results, snapshot = _run_drives(config, console, timing)
    with _measure_time("pictures of the camera", timing):
        pictures, camera_numbers = collect_camera_figures(config, figure_source)
    with _measure_time("report", timing):
        report = write_experiment_results(
            config,
            results,
            pictures,
            snapshot=snapshot,
            camera_metrics=camera_numbers,
            timing_s=timing,
            subtitle=f"Run on {time.strftime('%Y-%m-%d')}, {platform.machine()}, "
            f"Python {platform.python_version()}, {config.num_runs} runs a set-up, seed {config.seed}.",
        )
    return _print_claims(config, report, console)


def _run_drives(
    config: ExperimentConfig, console: Console, timing: dict[str, float]
) -> tuple[list[SetupResult], DetectorSnapshot | None]:
    """Train and drive under progress bars."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    for name, address in config.remote_servers.items():
        console.print(f"{name}: server at {address.host}:{address.control_port}", markup=False)
    with Progress(*columns, TimeElapsedColumn(), console=console) as progress:
        steps = {s.name: config.num_runs * (len(s.route) - 1) for s in config.setups}
        tasks = {name: progress.add_task(f"{name}: steps", total=n) for name, n in steps.items()}
        tasks["train"] = progress.add_task(
            "train: labelled frames", total=config.num_training_frames
        )

        def advance(name: str) -> None:
            progress.advance(tasks[name])

        classifier, snapshot = None, None
        if SIM in config.setups:
            with _measure_time("training", timing):
                classifier, snapshot = train_classifier(config, advance)
        results = []
        for setup in config.setups:
            with _measure_time(f"{setup.name} drives", timing):
                results.append(run_setup(config, setup, classifier, advance))
        return results, snapshot


def _print_claims(config: ExperimentConfig, report: Path, console: Console) -> int:
    """Print the claims and where the report is."""
    claims = json.loads((config.output_folder / "summary.json").read_text(encoding="utf-8"))[
        "claims"
    ]
    table = Table("claim of the paper", "measured here", "holds")
    for claim in claims:
        verdict = "[green]yes" if claim["holds"] else "[red]no"
        table.add_row(claim["text"], claim["measured"], verdict)
    console.print(table)
    console.print(f"report: {report}", markup=False)
    return 0 if all(claim["holds"] for claim in claims) else 1


@contextmanager
def _measure_time(name: str, timing_s: dict[str, float]) -> Iterator[None]:
    begin = time.monotonic()
    yield
    timing_s[name] = time.monotonic() - begin


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="catoptra-experiment", description=__doc__)
    parser.add_argument("--configs", type=Path, metavar="DIR", help="default: the shipped ones")
    parser.add_argument("--output", type=Path, default=Path("out/demo"), metavar="DIR")
    parser.add_argument("--setup", choices=["sim", "real", "both"], default="both")
    parser.add_argument("--runs", type=int, default=20, help="seeds a set-up")
    parser.add_argument("--seed", type=int, default=0, help="of all random numbers")
    parser.add_argument("--training-frames", type=int, default=30)
    parser.add_argument("--renderer", choices=["auto", "trace", "raster"], default="auto")
    parser.add_argument(
        "--server", type=_parse_server_argument, action="append", default=[],
        metavar="SETUP=HOST[:CONTROL[:IMAGE]]",
        help="use this lockstep server for a set-up instead of starting one",
    )  # fmt: skip
    parser.add_argument(
        "--pictures", choices=[d.value for d in FigureSource], default=FigureSource.LOCAL.value,
        help="who draws the camera's: the server installed here, somebody else into DIR, nobody",
    )  # fmt: skip
    parser.add_argument(
        "--patience", type=float, default=60.0, metavar="S", help="for what is elsewhere"
    )
    return parser


def _experiment_config(parsed: argparse.Namespace) -> ExperimentConfig:
    wanted = tuple(s for s in SETUPS if parsed.setup in (s.name, "both"))
    return ExperimentConfig(
        config_folder=parsed.configs,
        output_folder=parsed.output,
        setups=wanted,
        num_runs=max(1, parsed.runs),
        seed=parsed.seed,
        num_training_frames=max(1, parsed.training_frames),
        server_arguments=("--renderer", parsed.renderer),
        remote_servers=dict(parsed.server),
        timeout_s=parsed.patience,
    )


def _parse_server_argument(text: str) -> tuple[str, ServerAddress]:
    try:
        return parse_server_address(text)
    except CatoptraError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


if __name__ == "__main__":
    sys.exit(main())
