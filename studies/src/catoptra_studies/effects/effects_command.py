"""The command `catoptra-studies effects`: show each effect, and the levels at which robots fail.

Three parts, of which `--only` selects one. The pages render with the server's own code. The
decisions compare every decision of the server with the truth. The sweeps drive robots through
server processes and find the level at which colour classification fails.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from datetime import date
from pathlib import Path

from catoptra_protocol.command_line import EXIT_FAILURE, CommandParser, parse_count, parse_integer
from catoptra_studies.commands import (
    ProgressDisplay,
    add_output,
    make_parser,
    open_progress,
    parse_study,
    print_line,
)
from catoptra_studies.degradation.degradation_report import (
    failure_table,
    format_sweep_summary,
    write_degradation_results,
)
from catoptra_studies.degradation.degradation_study import (
    SweepResult,
    num_drives,
    run_degradation_study,
)
from catoptra_studies.degradation.degradation_sweeps import SWEEPS
from catoptra_studies.experiment.experiment_runner import ExperimentConfig
from catoptra_studies.experiment.experiment_setups import SIM
from catoptra_studies.reports import replace_block

_PARTS = ("pages", "decisions", "sweeps")
# Places in each of the 15 worlds, three or one for each condition, in four motions each: 1 080
# situations.
_NUM_PLACES = 18
_NUM_QUICK_PLACES = 6
# Two thirds of the experiment's: a sweep trains for each of fifty levels anew.
_NUM_TRAINING_FRAMES = 20
_SWEEP_SLUGS = [sweep.slug for sweep in SWEEPS]


def main(arguments: Sequence[str]) -> int:
    """Run the study; return 1 for decisions that differ from the truth too often, otherwise 0."""
    parser = _make_parser()
    parsed = parse_study(parser, arguments)
    if parsed.page and (parsed.sweep or parsed.only == "pages"):
        parser.error("--page gets tables of decisions and of all sweeps: leave out --sweep and "
                     "--only pages")  # fmt: skip
    results: tuple[SweepResult, ...] = ()
    parts = (parsed.only,) if parsed.only else _PARTS
    are_right = True
    with open_progress() as progress:
        if "pages" in parts:
            _write_pages(parsed.out, progress)
        if "decisions" in parts:
            are_right = _check_decisions(parsed, progress)
        if "sweeps" in parts:
            results = _run_sweeps(parsed, progress)
    if parsed.page and results:
        num_runs = _experiment_config(parsed).num_runs
        summary = format_sweep_summary(results, num_runs=num_runs, seed=parsed.seed)
        replace_block(parsed.page, "sweeps", summary)
    if results:
        print_line(failure_table(results))
    print_line(f"written: {parsed.out}")
    return 0 if are_right else EXIT_FAILURE


def _write_pages(folder: Path, progress: ProgressDisplay) -> None:
    # Imported here: the sweeps need no server in this interpreter, only one to start or connect to.
    from catoptra_studies.effects.effect_cases import EFFECT_CASES
    from catoptra_studies.effects.effect_pages import write_effect_pages

    write_effect_pages(folder, on_page=progress.add_task("pages of effects", len(EFFECT_CASES)))


def _check_decisions(parsed: argparse.Namespace, progress: ProgressDisplay) -> bool:
    """Compare decisions with the truth, and write the report; whether all are right."""
    from catoptra_studies.effects.decision_experiment import DecisionStudy, run_decision_study
    from catoptra_studies.effects.decision_report import evaluate_decisions, write_decision_report

    num_places = parsed.places or (_NUM_QUICK_PLACES if parsed.quick else _NUM_PLACES)
    study = DecisionStudy(num_places=num_places, seed=parsed.seed)
    on_place = progress.add_task("places of decisions", num_places * len(study.worlds))
    decisions = run_decision_study(study, on_place=on_place)
    report = evaluate_decisions(decisions)
    write_decision_report(parsed.out, report, decisions)
    if parsed.page:
        extent = f"{date.today()}, {report.num_situations} situations of seed {parsed.seed}:"
        replace_block(parsed.page, "decisions", f"{extent}\n\n{report}")
    print_line(str(report))
    return not report.failures


def _run_sweeps(parsed: argparse.Namespace, progress: ProgressDisplay) -> tuple[SweepResult, ...]:
    config = _experiment_config(parsed)
    # In the order of the table, in whatever order given.
    sweeps = [sweep for sweep in SWEEPS if sweep.slug in (parsed.sweep or _SWEEP_SLUGS)]
    results = run_degradation_study(
        config,
        sweeps,
        robot_folder=parsed.configs / "robots",
        on_drive=progress.add_task("drives", num_drives(config, sweeps)),
    )
    write_degradation_results(parsed.out, config, results)
    return results


def _experiment_config(parsed: argparse.Namespace) -> ExperimentConfig:
    """The simulated drive; robot files and servers' logs go into a folder of their own."""
    folder: Path = parsed.out / "degradation"
    folder.mkdir(parents=True, exist_ok=True)
    return ExperimentConfig(
        config_folder=parsed.configs,
        output_folder=folder,
        setups=(SIM,),
        num_runs=1 if parsed.quick else parsed.runs,
        seed=parsed.seed,
        num_training_frames=_NUM_TRAINING_FRAMES,
        # Two servers run at a time, and detectors, too: one thread each keeps two cores busy.
        server_arguments=("--renderer", "trace", "--threads", "1"),
    )


def _make_parser() -> CommandParser:
    parser = make_parser(
        "effects",
        "Draw each image effect where it is needed, compare decisions about effects "
        "with the truth, and find the levels of degraded images at which colour classification and "
        "localization fail.",
    )
    add = parser.add_argument
    add("--configs", type=Path, default=Path("configs"), metavar="DIR",
        help="folder with robots/, worlds/ and landmarks/")  # fmt: skip
    add_output(parser, "out/effects", "folder for pages, report and plots")
    add("--page", type=Path, metavar="FILE",
        help="file whose blocks decisions and sweeps get the tables")  # fmt: skip
    add("--only", choices=_PARTS, help="run one part alone (default: all)")
    add("--sweep", action="append", choices=_SWEEP_SLUGS,
        help="only this sweep; may be given several times (default: all)")  # fmt: skip
    add("--runs", type=parse_count, default=2, metavar="N", help="drives for each level")
    add("--places", type=parse_count, metavar="N",
        help="places in each world at which decisions are compared "
        f"(default: {_NUM_PLACES}, or {_NUM_QUICK_PLACES} with --quick)")  # fmt: skip
    add("--quick", action="store_true", help="one drive for each level, six places in each world")
    add("--seed", type=parse_integer, default=0, metavar="N", help="seed of all random numbers")
    return parser
