"""`python -m catoptra_client.experiment`: the paper's experiment in both set-ups, with its report.

Has the camera's pictures drawn, starts a server process for each set-up, drives every seed, writes
report.html, its pictures and summary.json. Only this module of the experiment prints.
"""

from __future__ import annotations

import argparse
import json
import platform
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from catoptra_client.experiment.report import Picture
from catoptra_client.experiment.results import write_results
from catoptra_client.experiment.session import (
    Plan,
    SetupResult,
    Snapshot,
    run_setup,
    train_classifier,
)
from catoptra_client.experiment.setups import SETUPS, SIM
from catoptra_protocol.errors import CatoptraError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the experiment; 0 = done and every claim holds, 1 = it failed or one does not."""
    plan = _plan(_parser().parse_args(arguments))
    console = Console()
    try:
        plan.output.mkdir(parents=True, exist_ok=True)
        return _run(plan, console)
    except CatoptraError as error:
        Console(stderr=True).print(f"experiment: {error}", style="red", markup=False)
        return 1


def _run(plan: Plan, console: Console) -> int:
    timing: dict[str, float] = {}
    with _timed("pictures of the camera", timing):
        camera_pictures, camera_numbers = _camera_pictures(plan)
    results, snapshot = _drives(plan, console, timing)
    with _timed("report", timing):
        report = write_results(
            plan,
            results,
            camera_pictures,
            snapshot=snapshot,
            camera_numbers=camera_numbers,
            timing_s=timing,
            subtitle=f"Run on {time.strftime('%Y-%m-%d')}, {platform.machine()}, "
            f"Python {platform.python_version()}, {plan.runs} runs a set-up, seed {plan.seed}.",
        )
    return _conclude(plan, report, console)


def _drives(
    plan: Plan, console: Console, timing: dict[str, float]
) -> tuple[list[SetupResult], Snapshot | None]:
    """Train and drive under progress bars."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=console) as progress:
        steps = {s.name: plan.runs * (len(s.route) - 1) for s in plan.setups}
        tasks = {name: progress.add_task(f"{name}: steps", total=n) for name, n in steps.items()}
        tasks["train"] = progress.add_task("train: labelled frames", total=plan.training_frames)

        def advance(name: str) -> None:
            progress.advance(tasks[name])

        classifier, snapshot = None, None
        if SIM in plan.setups:
            with _timed("training", timing):
                classifier, snapshot = train_classifier(plan, advance)
        results = []
        for setup in plan.setups:
            with _timed(f"{setup.name} drives", timing):
                results.append(run_setup(plan, setup, classifier, advance))
        return results, snapshot


def _camera_pictures(plan: Plan) -> tuple[list[Picture], dict[str, Any]]:
    """Have the server's own command draw faces, cube, mirrors and comparisons."""
    worlds = plan.configs / "worlds"
    command = [
        *(sys.executable, "-m", "catoptra_server.figures", "--output", str(plan.output)),
        *("--robot", str(plan.configs / "robots" / "p2at_omni.ini"), "--world", str(plan.world)),
        *("--rings-world", str(worlds / "incidence_rings.ini")),
    ]
    if subprocess.run(command, check=False).returncode != 0:
        raise CatoptraError("the pictures of the camera could not be drawn: see the lines above")
    drawn = json.loads((plan.output / "figures.json").read_text(encoding="utf-8"))
    pictures = [
        Picture(
            entry["file"],
            f"{entry['title']} (the paper's {entry['figure']})",
            entry["caption"],
            entry["alt"],
        )
        for entry in drawn["figures"]
    ]
    return pictures, drawn["numbers"]


def _conclude(plan: Plan, report: Path, console: Console) -> int:
    """Print the claims and where the report is."""
    claims = json.loads((plan.output / "summary.json").read_text(encoding="utf-8"))["claims"]
    table = Table("claim of the paper", "measured here", "holds")
    for claim in claims:
        verdict = "[green]yes" if claim["holds"] else "[red]no"
        table.add_row(claim["text"], claim["measured"], verdict)
    console.print(table)
    console.print(f"report: {report}", markup=False)
    return 0 if all(claim["holds"] for claim in claims) else 1


@contextmanager
def _timed(name: str, timing: dict[str, float]) -> Iterator[None]:
    begin = time.monotonic()
    yield
    timing[name] = time.monotonic() - begin


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="catoptra-experiment", description=__doc__)
    parser.add_argument("--configs", type=Path, default=Path("configs"), metavar="DIR")
    parser.add_argument("--output", type=Path, default=Path("out/demo"), metavar="DIR")
    parser.add_argument("--setup", choices=["sim", "real", "both"], default="both")
    parser.add_argument("--runs", type=int, default=20, help="seeds a set-up")
    parser.add_argument("--seed", type=int, default=0, help="of all random numbers")
    parser.add_argument("--training-frames", type=int, default=30)
    parser.add_argument("--renderer", choices=["auto", "trace", "raster"], default="auto")
    return parser


def _plan(parsed: argparse.Namespace) -> Plan:
    wanted = tuple(s for s in SETUPS if parsed.setup in (s.name, "both"))
    return Plan(
        configs=parsed.configs,
        output=parsed.output,
        setups=wanted,
        runs=max(1, parsed.runs),
        seed=parsed.seed,
        training_frames=max(1, parsed.training_frames),
        server_arguments=("--renderer", parsed.renderer),
    )


if __name__ == "__main__":
    sys.exit(main())
