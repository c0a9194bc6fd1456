"""`python -m catoptra_client.experiment.degraded`: where colour classification starts to fail.

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

from catoptra_client.experiment.degraded.ladders import LADDERS, Ladder
from catoptra_client.experiment.degraded.study import LadderResult, drives, run_study
from catoptra_client.experiment.degraded.telling import document, markdown, verdict_table
from catoptra_client.experiment.pictures.degraded import draw_all, draw_ladder
from catoptra_client.experiment.session import Plan
from catoptra_client.experiment.setups import SIM
from catoptra_protocol.errors import CatoptraError

EXIT_CANNOT_DRIVE = 2
_TRAINING_FRAMES = 20


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study; return 0, or 2 with a message if it could not be done."""
    parsed = _parser().parse_args(arguments)
    console = Console(stderr=True)
    try:
        plan = _plan(parsed)
        ladders = [ladder for ladder in LADDERS if ladder.slug in (parsed.ladder or _SLUGS)]
        results = _measured(plan, ladders, parsed.configs / "robots", console)
        write_study(parsed.output, plan, results)
    except (CatoptraError, OSError) as error:
        console.print(f"degraded: {error}", style="red", markup=False, soft_wrap=True)
        return EXIT_CANNOT_DRIVE
    for line in verdict_table(results):
        Console().print(line, markup=False, highlight=False, soft_wrap=True)
    return 0


def write_study(output: Path, plan: Plan, results: Sequence[LadderResult]) -> None:
    """Write degraded.json, DEGRADED.md, degraded.png and a page a ladder."""
    text = json.dumps(document(results, runs=plan.runs, seed=plan.seed), indent=2, allow_nan=False)
    (output / "degraded.json").write_text(text + "\n", encoding="utf-8")
    (output / "DEGRADED.md").write_text(markdown(results, runs=plan.runs), encoding="utf-8")
    draw_all(output / "degraded.png", results)
    for result in results:
        draw_ladder(output / f"degraded_{result.ladder.slug}.png", result)


def _measured(
    plan: Plan, ladders: Sequence[Ladder], robots: Path, console: Console
) -> tuple[LadderResult, ...]:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    with Progress(*columns, TimeElapsedColumn(), console=console) as progress:
        task = progress.add_task("drives", total=drives(plan, ladders))
        return run_study(plan, ladders, robots=robots, on_drive=lambda: progress.advance(task))


def _plan(parsed: argparse.Namespace) -> Plan:
    """Return the plan; robot files and servers' logs go into a folder of their own."""
    folder: Path = parsed.output / "degraded"
    folder.mkdir(parents=True, exist_ok=True)
    return Plan(
        configs=parsed.configs,
        output=folder,
        setups=(SIM,),
        runs=1 if parsed.quick else max(1, parsed.runs),
        seed=parsed.seed,
        training_frames=_TRAINING_FRAMES,
        server_arguments=("--renderer", "trace", "--threads", "1"),
    )


_SLUGS = [ladder.slug for ladder in LADDERS]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m catoptra_client.experiment.degraded",
        description="Show where colour classification starts to fail as pictures get worse.",
    )
    add = parser.add_argument
    add("--configs", type=Path, default=Path("configs"), metavar="DIR")
    add("--output", type=Path, default=Path("out/effects"), metavar="DIR")
    add("--ladder", action="append", choices=_SLUGS, help="only this one; may be repeated")
    add("--runs", type=int, default=2, help="seeds a rung")
    add("--quick", action="store_true", help="one seed a rung")
    add("--seed", type=int, default=0, help="of all random numbers")
    return parser


if __name__ == "__main__":
    sys.exit(main())
