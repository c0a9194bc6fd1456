"""Soak: an honest robot and clients of its camera beside all attackers at once.

Run: make soak, or .venv/bin/python tests/load/run.py --seconds 60. First a control run with the
same honest load and no attack, then the attack, each for --seconds or CATOPTRA_SOAK_S; then both
for a tenth of that time under a lockstep clock, where the attackers send steps. Writes
out/soak/soak.json and out/soak/report.md. The exit status is 0 only if every requirement holds.

One attack alone, its honest clients before, during and after:
.venv/bin/python tests/load/run.py --attack flood_scans --seconds 4
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Console

sys.path.insert(0, str(Path(__file__).parents[1]))

from helpers.requirement_results import RequirementResult, print_requirements
from load.attacks import ATTACKS, LOCKSTEP_ATTACKS, SOAK_ARGUMENTS
from load.single_attack import HEADINGS, format_row, measure_attack
from load.soak import LoadResult, run_load
from load.soak_limits import SoakLimits, evaluate_lockstep, evaluate_soak

ROOT = Path(__file__).parents[2]
_ALL = "all"
_DEFAULT_S = 600.0
_DEFAULT_ATTACK_S = 4.0
_LOCKSTEP_FRACTION = 0.1
# A shorter run may see the last of seven accuracies after a minute: a view of 8 x 8 samples.
_SHORT_RUN_FILL = {"resident_mb": 85.0}


def main() -> int:
    """Run the soak, or single attacks, and print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--attack", action="append", choices=[*ATTACKS, _ALL], default=[])
    parser.add_argument("--seconds", type=float)
    parser.add_argument("--output", type=Path, default=ROOT / "out/soak")
    parsed = parser.parse_args()
    if parsed.attack:
        names = list(ATTACKS) if _ALL in parsed.attack else parsed.attack
        _print_attacks(names, parsed.seconds or _DEFAULT_ATTACK_S, parsed.output)
        return 0
    duration_s = parsed.seconds or float(os.environ.get("CATOPTRA_SOAK_S") or _DEFAULT_S)
    results, runs = asyncio.run(_run_soak(parsed.output, duration_s))
    _write_report(parsed.output, results, runs)
    return print_requirements(results, Console())


def _print_attacks(names: Sequence[str], seconds: float, folder: Path) -> None:
    """Print a row of a Markdown table for each attack, as soon as measured."""
    print(_table_row(HEADINGS), "|" + "---|" * len(HEADINGS), sep="\n", flush=True)
    for name in names:
        result = asyncio.run(measure_attack(name, seconds, folder))
        print(_table_row(format_row(result)), flush=True)


async def _run_soak(
    folder: Path, duration_s: float
) -> tuple[list[RequirementResult], dict[str, LoadResult]]:
    limits = SoakLimits(fill={} if duration_s >= _DEFAULT_S else _SHORT_RUN_FILL)
    control = await run_load(folder / "control", duration_s, *SOAK_ARGUMENTS)
    attacked = await run_load(
        folder / "attacked", duration_s, *SOAK_ARGUMENTS, attacks=tuple(ATTACKS)
    )
    results = evaluate_soak(control, attacked, limits, num_attacks=len(ATTACKS))
    runs = {"control": control, "attacked": attacked}
    lockstep_s = _LOCKSTEP_FRACTION * duration_s
    for name, attacks in (("lockstep_control", ()), ("lockstep_attacked", LOCKSTEP_ATTACKS)):
        runs[name] = await run_load(
            folder / name, lockstep_s, "--clock", "lockstep", attacks=attacks
        )
    results += evaluate_lockstep(
        runs["lockstep_control"],
        runs["lockstep_attacked"],
        limits,
        num_attacks=len(LOCKSTEP_ATTACKS),
    )
    return results, runs


def _write_report(
    folder: Path, results: Sequence[RequirementResult], runs: dict[str, LoadResult]
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    document = {
        "results": [asdict(result) for result in results],
        "runs": {name: asdict(run) for name, run in runs.items()},
    }
    (folder / "soak.json").write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    rows = [
        _table_row((result.requirement, result.measurement, "yes" if result.is_met else "no"))
        for result in results
    ]
    lines = ["# Soak", "", _table_row(("requirement", "measured", "holds")), "|---|---|---|", *rows]
    (folder / "report.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _table_row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    sys.exit(main())
