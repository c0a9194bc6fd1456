"""`python -m catoptra_studies.degradation`: where colour classification starts to fail.

Starts a server for each rung of each ladder, drives the paper's simulated route on it, and has a
classifier taught by clean pictures and one taught anew find beacons in the same frames. Writes
degraded.json, DEGRADED.md and pictures.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from catoptra_protocol.errors import CatoptraError
from catoptra_studies.degradation.degradation_plot import draw_all_sweeps, draw_sweep
from catoptra_studies.degradation.degradation_report import (
    failure_table,
    format_degradation_report,
    summarise_degradation,
)
from catoptra_studies.degradation.degradation_study import (
    SweepResult,
    num_drives,
    run_degradation_study,
)
from catoptra_studies.degradation.degradation_sweeps import SWEEPS, DegradationSweep
from catoptra_studies.experiment.experiment_runner import ExperimentConfig
from catoptra_studies.experiment.experiment_setups import SIM

EXIT_FAILURE = 2
_NUM_TRAINING_FRAMES = 20


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study; return 0, or 2 with a message if it could not be done."""
    parsed = _parser().parse_args(arguments)
    console = Console(stderr=True)
    try:
        plan = _experiment_config(parsed)
        ladders = [ladder for ladder in SWEEPS if ladder.slug in (parsed.ladder or _SWEEP_SLUGS)]
        results = _run_with_progress(plan, ladders, parsed.configs / "robots", console)
        write_degradation_results(parsed.output, plan, results)
    except (CatoptraError, OSError) as error:
        console.print(f"degraded: {error}", style="red", markup=False, soft_wrap=True)
        return EXIT_FAILURE
    for line in failure_table(results):
        Console().print(line, markup=False, highlight=False, soft_wrap=True)
    return 0


def write_degradation_results(
    output_folder: Path, config: ExperimentConfig, results: Sequence[SweepResult]
) -> None:
    """Write degraded.json, DEGRADED.md, degraded.png and a page a ladder."""
    text = json.dumps(
        summarise_degradation(results, num_runs=config.num_runs, seed=config.seed),
        indent=2,
        allow_nan=False,
    )
    (output_folder / "degraded.json").write_text(text + "\n", encoding="utf-8")
    (output_folder / "DEGRADED.md").write_text(
        format_degradation_report(results, num_runs=config.num_runs), encoding="utf-8"
    )
    draw_all_sweeps(output_folder / "degraded.png", results)
    for result in results:
        draw_sweep(output_folder / f"degraded_{result.sweep.slug}.png", result)


def _run_with_progress(
    config: ExperimentConfig,
    sweeps: Sequence[DegradationSweep],
    robot_folder: Path,
    console: Console,
) -> tuple[SweepResult, ...]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=console) as progress:
        task = progress.add_task("drives", total=num_drives(config, sweeps))
        return run_degradation_study(
            config, sweeps, robot_folder=robot_folder, on_drive=lambda: progress.advance(task)
        )


def _experiment_config(parsed: argparse.Namespace) -> ExperimentConfig:
    """Return the plan; robot files and servers' logs go into a folder of their own."""
    folder: Path = parsed.output / "degraded"
    folder.mkdir(parents=True, exist_ok=True)
    return ExperimentConfig(
        config_folder=parsed.configs,
        output_folder=folder,
        setups=(SIM,),
        num_runs=1 if parsed.quick else max(1, parsed.runs),
        seed=parsed.seed,
        num_training_frames=_NUM_TRAINING_FRAMES,
        server_arguments=("--renderer", "trace", "--threads", "1"),
    )


_SWEEP_SLUGS = [ladder.slug for ladder in SWEEPS]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m catoptra_studies.degradation",
        description="Show where colour classification starts to fail as pictures get worse.",
    )
    add = parser.add_argument
    add("--configs", type=Path, default=Path("configs"), metavar="DIR")
    add("--output", type=Path, default=Path("out/effects"), metavar="DIR")
    add("--ladder", action="append", choices=_SWEEP_SLUGS, help="only this one; may be repeated")
    add("--runs", type=int, default=2, help="seeds a rung")
    add("--quick", action="store_true", help="one seed a rung")
    add("--seed", type=int, default=0, help="of all random numbers")
    return parser


if __name__ == "__main__":
    sys.exit(main())
