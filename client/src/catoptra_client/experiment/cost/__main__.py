"""`python -m catoptra_client.experiment.cost`: drive the key steps, add what they are worth.

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

from catoptra_client.experiment.cost.key_steps import (
    KeyStep,
    add_landmarks,
    key_steps,
    read_study,
    write_robot,
)
from catoptra_client.experiment.cost.worth import summary, worth
from catoptra_client.experiment.session import (
    Plan,
    SetupResult,
    run_setup,
    train_classifier,
)
from catoptra_client.experiment.setups import SIM, Setup
from catoptra_client.landmarks import ColourClassifier
from catoptra_protocol.errors import CatoptraError

EXIT_CANNOT_DRIVE = 2
_TRAINING_FRAMES = 30


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive and add; return 0, or 2 with a message if it could not be done."""
    parsed = _parser().parse_args(arguments)
    console = Console(stderr=True)
    try:
        _add(parsed, console)
    except (CatoptraError, OSError) as error:
        console.print(f"cost: {error}", style="red", markup=False, soft_wrap=True)
        return EXIT_CANNOT_DRIVE
    return 0


def _add(parsed: argparse.Namespace, console: Console) -> None:
    path = parsed.output / "cost.json"
    study = read_study(path)
    steps = key_steps(study)
    with _progress(console) as progress:
        plan = _plan(parsed, steps[-1])
        classifier, _ = train_classifier(
            plan, _advance(progress, "train: labelled frames", _TRAINING_FRAMES)
        )
        rows = []
        for step in steps:
            advance = _advance(progress, step.name, plan.runs * (len(SIM.route) - 1))
            result = _driven(parsed, step, classifier, advance)
            rows.append(worth(step.name, result, plan.landmarks))
    add_landmarks(study, summary(rows, result), path)


def _advance(progress: Progress, title: str, total: int) -> Callable[[str], None]:
    task = progress.add_task(title, total=total)
    return lambda _: progress.advance(task)


def _driven(
    parsed: argparse.Namespace,
    step: KeyStep,
    classifier: ColourClassifier,
    advance: Callable[[str], None],
) -> SetupResult:
    plan = _plan(parsed, step)
    return run_setup(plan, plan.setups[0], classifier, advance)


def _plan(parsed: argparse.Namespace, step: KeyStep) -> Plan:
    """Return the plan of the paper's simulated run, drawn as a step says."""
    return Plan(
        configs=parsed.configs,
        output=parsed.output,
        setups=(_setup(parsed, step),),
        runs=1 if parsed.quick else parsed.runs,
        seed=parsed.seed,
        training_frames=_TRAINING_FRAMES,
        server_arguments=("--renderer", step.renderer),
    )


def _setup(parsed: argparse.Namespace, step: KeyStep) -> Setup:
    """Write the step's robot file into the output; return the set-up that drives it."""
    robot: Path = parsed.output.resolve() / "robot.ini"
    write_robot(step, parsed.configs / "robots" / SIM.robot_file, robot)
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
        prog="python -m catoptra_client.experiment.cost",
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
