"""`python -m catoptra_studies.experiment.cost`: drive the key steps, add what they are worth.

For each key step of OUTPUT/cost.json a server process of its own draws as the step says; the same
seeds drive round the field, find landmarks in the frames that come over TCP, and localise by them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from catoptra_client.landmarks import ColourClassifier
from catoptra_protocol.errors import CatoptraError
from catoptra_studies.accuracy_cost.key_levels import (
    KeyLevel,
    read_cost_json,
    select_key_levels,
    write_localization,
    write_robot_file,
)
from catoptra_studies.accuracy_cost.localization_accuracy import (
    localization_accuracy,
    summarise_localization,
)
from catoptra_studies.experiment.experiment_runner import (
    ExperimentConfig,
    SetupResult,
    run_setup,
    train_classifier,
)
from catoptra_studies.experiment.experiment_setups import SIM, ExperimentSetup

EXIT_FAILURE = 2
_NUM_TRAINING_FRAMES = 30


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive and add; return 0, or 2 with a message if it could not be done."""
    parsed = _parser().parse_args(arguments)
    console = Console(stderr=True)
    try:
        _add_localization(parsed, console)
    except (CatoptraError, OSError) as error:
        console.print(f"cost: {error}", style="red", markup=False, soft_wrap=True)
        return EXIT_FAILURE
    return 0


def _add_localization(parsed: argparse.Namespace, console: Console) -> None:
    path = parsed.output / "cost.json"
    study = read_cost_json(path)
    steps = select_key_levels(study)
    with _progress(console) as progress:
        plan = _level_config(parsed, steps[-1])
        classifier, _ = train_classifier(
            plan, _progress_callback(progress, "train: labelled frames", _NUM_TRAINING_FRAMES)
        )
        rows = []
        for step in steps:
            advance = _progress_callback(progress, step.name, plan.num_runs * (len(SIM.route) - 1))
            result = _run_level(parsed, step, classifier, advance)
            rows.append(localization_accuracy(step.name, result, plan.landmarks))
    write_localization(study, summarise_localization(rows, result), path)


def _progress_callback(progress: Progress, title: str, total: int) -> Callable[[str], None]:
    task = progress.add_task(title, total=total)
    return lambda _: progress.advance(task)


def _run_level(
    parsed: argparse.Namespace,
    level: KeyLevel,
    classifier: ColourClassifier,
    on_progress: Callable[[str], None],
) -> SetupResult:
    plan = _level_config(parsed, level)
    return run_setup(plan, plan.setups[0], classifier, on_progress)


def _level_config(parsed: argparse.Namespace, level: KeyLevel) -> ExperimentConfig:
    """Return the plan of the paper's simulated run, drawn as a step says."""
    return ExperimentConfig(
        config_folder=parsed.configs,
        output_folder=parsed.output,
        setups=(_level_setup(parsed, level),),
        num_runs=1 if parsed.quick else parsed.runs,
        seed=parsed.seed,
        num_training_frames=_NUM_TRAINING_FRAMES,
        server_arguments=("--renderer", level.renderer),
    )


def _level_setup(parsed: argparse.Namespace, level: KeyLevel) -> ExperimentSetup:
    """Write the step's robot file into the output; return the set-up that drives it."""
    robot: Path = parsed.output.resolve() / "robot.ini"
    write_robot_file(level, parsed.configs / "robots" / SIM.robot_file, robot)
    return replace(SIM, robot_file=str(robot))


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description:<34}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=console,
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m catoptra_studies.experiment.cost",
        description="Add landmarks and localisation to what catoptra-server cost has measured.",
    )
    add = parser.add_argument
    add("--configs", type=Path, default=Path("configs"), metavar="DIR")
    add("--output", type=Path, default=Path("out/cost"), metavar="DIR", help="has cost.json")
    add("--runs", type=int, default=10, help="seeds a step")
    add("--quick", action="store_true", help="one seed a step")
    add("--seed", type=int, default=0, help="of all random numbers")
    return parser


if __name__ == "__main__":
    sys.exit(main())
