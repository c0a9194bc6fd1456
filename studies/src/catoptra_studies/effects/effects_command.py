"""The command `catoptra-studies effects`: show each effect, and the levels at which robots fail.

Two parts, of which `--only` selects one. The pages render with the server's own code. The sweeps
drive robots through server processes and find the level at which colour classification fails.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from catoptra_protocol.errors import CatoptraError
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
from catoptra_studies.progress_display import (
    ProgressDisplay,
    open_progress,
    print_error,
    print_line,
)
from catoptra_studies.reports.marked_block import replace_block

EXIT_FAILURE = 2
# Two thirds of the experiment's: a sweep trains for each of fifty levels anew.
_NUM_TRAINING_FRAMES = 20
_SWEEP_SLUGS = [sweep.slug for sweep in SWEEPS]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study; return 0, or 2 after one line about the reason."""
    parser = _make_parser()
    parsed = parser.parse_args(arguments)
    if parsed.page and (parsed.sweep or parsed.only == "pages"):
        parser.error("--page gets the table of all sweeps: leave out --sweep and --only pages")
    results: tuple[SweepResult, ...] = ()
    try:
        parsed.output.mkdir(parents=True, exist_ok=True)
        with open_progress() as progress:
            if parsed.only != "sweeps":
                _write_pages(parsed.output, progress)
            if parsed.only != "pages":
                results = _run_sweeps(parsed, progress)
        if parsed.page:
            _update_page(parsed, results)
    except (CatoptraError, OSError) as error:
        print_error(f"catoptra-studies effects: {error}")
        return EXIT_FAILURE
    if results:
        print_line(failure_table(results))
    print_line(f"written: {parsed.output}")
    return 0


def _write_pages(folder: Path, progress: ProgressDisplay) -> None:
    # Imported here: the sweeps need no server in this interpreter, only one to start or connect to.
    from catoptra_studies.effects.effect_cases import EFFECT_CASES
    from catoptra_studies.effects.effect_pages import write_effect_pages

    write_effect_pages(folder, on_page=progress.add_task("pages of effects", len(EFFECT_CASES)))


def _run_sweeps(parsed: argparse.Namespace, progress: ProgressDisplay) -> tuple[SweepResult, ...]:
    config = _experiment_config(parsed)
    # In the order of the table, however they are given.
    sweeps = [sweep for sweep in SWEEPS if sweep.slug in (parsed.sweep or _SWEEP_SLUGS)]
    results = run_degradation_study(
        config,
        sweeps,
        robot_folder=parsed.configs / "robots",
        on_drive=progress.add_task("drives", num_drives(config, sweeps)),
    )
    write_degradation_results(parsed.output, config, results)
    return results


def _update_page(parsed: argparse.Namespace, results: tuple[SweepResult, ...]) -> None:
    num_runs = _experiment_config(parsed).num_runs
    summary = format_sweep_summary(results, num_runs=num_runs, seed=parsed.seed)
    replace_block(parsed.page, "sweeps", summary)


def _experiment_config(parsed: argparse.Namespace) -> ExperimentConfig:
    """The simulated drive; robot files and servers' logs go into a folder of their own."""
    folder: Path = parsed.output / "degradation"
    folder.mkdir(parents=True, exist_ok=True)
    return ExperimentConfig(
        config_folder=parsed.configs,
        output_folder=folder,
        setups=(SIM,),
        num_runs=1 if parsed.quick else max(1, parsed.runs),
        seed=parsed.seed,
        num_training_frames=_NUM_TRAINING_FRAMES,
        # Two servers run at a time and detectors beside them: one thread each keeps two cores busy.
        server_arguments=("--renderer", "trace", "--threads", "1"),
    )


def _make_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="catoptra-studies effects",
        description="Draw each image effect where it is needed, and find the levels of degraded "
        "images at which colour classification and localization fail.",
    )
    add = parser.add_argument
    add("--configs", type=Path, default=Path("configs"), metavar="DIR",
        help="folder with robots/, worlds/ and landmarks/ (default configs)")  # fmt: skip
    add("--output", type=Path, default=Path("out/effects"), metavar="DIR",
        help="folder for pages, report and plots (default out/effects)")  # fmt: skip
    add("--page", type=Path, metavar="FILE", help="file whose sweeps block gets the table")
    add("--only", choices=["pages", "sweeps"], help="run one part alone")
    add("--sweep", action="append", choices=_SWEEP_SLUGS,
        help="only this sweep; may be given several times")  # fmt: skip
    add("--runs", type=int, default=2, help="drives for each level (default 2)")
    add("--quick", action="store_true", help="one drive for each level")
    add("--seed", type=int, default=0, help="seed of all random numbers")
    return parser
