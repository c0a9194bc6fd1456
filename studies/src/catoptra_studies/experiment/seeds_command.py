"""The command `catoptra-studies seeds`: the claims of `demo` with many seeds, without pictures.

Each seed trains, drives and filters as `demo --seed` does, and so has the same numbers; only live
page and figures are left out. Seeds run in parallel processes, each with separate servers. The
report has the shares over all runs, and the status that `demo` ends with for each seed.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context

from catoptra_studies.commands import (
    add_output,
    make_parser,
    open_progress,
    print_line,
    print_table,
    run_study,
)
from catoptra_studies.experiment.experiment_results import summarize_experiment
from catoptra_studies.experiment.experiment_runner import (
    ExperimentConfig,
    run_setup,
    train_classifier,
)
from catoptra_studies.experiment.experiment_setups import SETUPS
from catoptra_studies.experiment.paper_claims import (
    UNTYPICAL_STATEMENTS,
    Claim,
    evaluate_claims,
    pool_shares,
)
from catoptra_studies.reports import markdown_table, wrap_paragraph, write_json


@dataclass(frozen=True, slots=True)
class SeedResult:
    """Statements counted over the runs of one seed."""

    seed: int

    claims: tuple[Claim, ...]
    """The paper's statements that decide the status of `demo`."""

    untypical: tuple[Claim, ...]
    """Statements that the typical run does not satisfy; the status does not count these."""

    @property
    def status(self) -> int:
        """Exit status of `demo` with this seed."""
        return 0 if all(claim.is_confirmed for claim in self.claims) else 1


def _format_report(results: Sequence[SeedResult], *, num_runs: int) -> str:
    """Markdown with three tables: claims, untypical statements, and the seeds."""
    failed = [str(result.seed) for result in results if result.status]
    ending = f"1 with the seeds {', '.join(failed)}" if failed else "0 with every seed"
    sections = (
        "# The paper's claims with many seeds",
        wrap_paragraph(
            f"The seeds {results[0].seed} to {results[-1].seed} with {num_runs} runs of each "
            f"set-up: `demo` ends with status {ending}. A claim is confirmed with a seed where "
            "more than half of its runs satisfy it. Intervals are Wilson's of 95 %, over the runs "
            "of all seeds."
        ),
        _statement_table({r.seed: r.claims for r in results}, num_runs),
        "The paper's run shows these, too, but the typical run here does not; they are no claims:",
        _statement_table({r.seed: r.untypical for r in results}, num_runs),
        f"Runs of {num_runs} that satisfy each statement, in the order of the tables above:",
        _seed_table(results),
    )
    return "\n\n".join(sections) + "\n"


def _statement_table(by_seed: Mapping[int, Sequence[Claim]], num_runs: int) -> str:
    rows = []
    for claims in zip(*by_seed.values(), strict=True):
        fewest = min(claim.runs.num_satisfying for claim in claims)
        confirmed = sum(claim.is_confirmed for claim in claims)
        share = pool_shares(claim.runs for claim in claims)
        low, high = share.interval
        rows.append(
            [
                f"{claims[0].text} ({claims[0].criterion})",
                f"{share.share:.1%}",
                f"{low:.1%} to {high:.1%}",
                f"{fewest} of {num_runs}",
                f"{confirmed} of {len(claims)}",
            ]
        )
    header = ("statement", "share of all runs", "interval", "worst seed", "seeds above half")
    return markdown_table(header, rows)


def _seed_table(results: Sequence[SeedResult]) -> str:
    first = results[0]
    keys = [claim.key for claim in (*first.claims, *first.untypical)]
    rows = [
        [
            str(result.seed),
            *(str(c.runs.num_satisfying) for c in (*result.claims, *result.untypical)),
            str(result.status),
        ]
        for result in results
    ]
    return markdown_table(("seed", *keys, "status"), rows)


_EXIT_FAILURE = 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all seeds; return 0 where every claim is confirmed with every seed, otherwise 1."""
    parsed = _make_parser().parse_args(arguments)
    return run_study("seeds", parsed, _run, exit_failure=_EXIT_FAILURE)


def _run(parsed: argparse.Namespace) -> int:
    config = ExperimentConfig(
        config_folder=None,
        output_folder=parsed.output,
        setups=SETUPS,
        num_runs=max(1, parsed.runs),
        seed=0,
        num_training_frames=max(1, parsed.training_frames),
    )
    results = _run_seeds(config, range(max(1, parsed.seeds)), max(1, parsed.processes))
    _write_report(config, results)
    return _EXIT_FAILURE if any(result.status for result in results) else 0


def _evaluate_experiment(config: ExperimentConfig, seed: int) -> SeedResult:
    """Drive, filter and evaluate one seed, and write summary.json into a folder for this seed.

    Args:
        config: Experiment; the seed is replaced.
        seed: Seed to run.
    """
    folder = config.output_folder / f"seed_{seed}"
    folder.mkdir(exist_ok=True)
    seeded = replace(config, seed=seed, output_folder=folder)
    # As `demo` trains and drives, without a display.
    classifier, _ = train_classifier(seeded)
    results = [run_setup(seeded, setup, classifier) for setup in seeded.setups]
    summary = summarize_experiment(seeded, results)
    write_json(folder / "summary.json", summary)
    setups = summary["setups"]
    return SeedResult(
        seed, tuple(evaluate_claims(setups)), tuple(evaluate_claims(setups, UNTYPICAL_STATEMENTS))
    )


def _run_seeds(
    config: ExperimentConfig, seeds: Sequence[int], num_processes: int
) -> list[SeedResult]:
    results = []
    # Spawned, since a fork copies the locks of the display's thread. Leaving the block ends the
    # processes, after an error or Ctrl-C with the seeds that have not ended.
    pool = get_context("spawn").Pool(num_processes, _end_by_signal)
    with open_progress() as progress, pool:
        advance = progress.add_task("seeds", len(seeds))
        # In the order of the seeds; the first that fails ends the command.
        for result in pool.imap(partial(_evaluate_experiment, config), seeds):
            results.append(result)
            advance()
    return results


def _end_by_signal() -> None:
    """Let SIGTERM end a process and all servers of it; Ctrl-C is for the parent process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())


def _write_report(config: ExperimentConfig, results: Sequence[SeedResult]) -> None:
    report = config.output_folder / "seeds.md"
    report.write_text(_format_report(results, num_runs=config.num_runs), encoding="utf-8")
    rows = [
        (
            (claims[0].text, str(pool_shares(claim.runs for claim in claims))),
            all(claim.is_confirmed for claim in claims),
        )
        for claims in zip(*(result.claims for result in results), strict=True)
    ]
    print_table(("claim of the paper", "runs of all seeds", "with every seed"), rows)
    print_line(f"report: {report}")


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser(
        "seeds",
        "Evaluate the claims of demo with the seeds 0, 1, ..., without pictures. Fifty "
        "seeds of 20 runs take about 20 minutes on two cores. Writes seeds.md and the numbers of "
        "each seed.",
    )
    add = parser.add_argument
    add_output(parser, "out/experiment-seeds", "folder for seeds.md and a folder a seed")
    add("--seeds", type=int, default=50, help="number of seeds, from 0 (default 50)")
    add("--runs", type=int, default=20, help="drives for each set-up and seed (default 20)")
    add("--training-frames", type=int, default=30, help="frames for the classifier (default 30)")
    add("--processes", type=int, default=os.cpu_count() or 1,
        help="seeds at the same time (default: one a processor)")  # fmt: skip
    return parser
