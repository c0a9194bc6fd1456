"""The command `catoptra-studies seeds`: the claims of `demo` with many seeds, without pictures.

Each seed trains, drives and filters as `demo --seed` does, and so has the same numbers; only live
page and figures are left out. Seeds run in parallel processes, each with separate servers. The
report has the shares over all runs, and the status that `demo` ends with for each seed.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any

from catoptra_protocol.command_line import EXIT_FAILURE, CommandParser, parse_count
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.interrupts import start_without_interrupts
from catoptra_studies.commands import (
    add_output,
    make_parser,
    open_progress,
    parse_study,
    print_line,
    print_table,
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
)
from catoptra_studies.reports import markdown_table, replace_block, wrap_paragraph, write_json
from catoptra_studies.run_statistics import pool_shares


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
        return 1 if any(claim.is_refuted for claim in self.claims) else 0


def _format_report(results: Sequence[SeedResult], *, num_runs: int) -> str:
    """Markdown with three tables: claims, untypical statements, and the seeds."""
    failed = [str(result.seed) for result in results if result.status]
    ending = f"1 with the seeds {', '.join(failed)}" if failed else "0 with every seed"
    sections = (
        "# The paper's claims with many seeds",
        wrap_paragraph(
            f"The seeds {results[0].seed} to {results[-1].seed} with {num_runs} runs of each "
            f"set-up: `demo` ends with status {ending}. Intervals are Wilson's of 95 %, over the "
            "runs of all seeds. A seed confirms a claim where the interval of its own runs is "
            "above one half, and refutes it below; between, its runs do not decide."
        ),
        _statement_table([r.claims for r in results], num_runs),
        "The paper's run shows these, too, but the typical run here does not; they are no claims:",
        _statement_table([r.untypical for r in results], num_runs),
        f"Runs of {num_runs} that satisfy each statement, in the order of the tables above:",
        _seed_table(results),
    )
    return "\n\n".join(sections) + "\n"


def _pool_seeds(by_seed: Iterable[Sequence[Claim]]) -> Iterator[tuple[Claim, Sequence[Claim]]]:
    """Yield each statement, counted over the runs of all seeds, and its counts by seed."""
    for claims in zip(*by_seed, strict=True):
        yield replace(claims[0], runs=pool_shares(claim.runs for claim in claims)), claims


def _statement_table(by_seed: Iterable[Sequence[Claim]], num_runs: int) -> str:
    rows = []
    for pooled, claims in _pool_seeds(by_seed):
        fewest = min(claim.runs.num_satisfying for claim in claims)
        confirmed, refuted = (
            sum(map(attrgetter(name), claims)) for name in ("is_confirmed", "is_refuted")
        )
        low, high = pooled.runs.interval
        rows.append(
            [
                f"{pooled.text} ({pooled.criterion})",
                f"{pooled.runs.share:.1%}",
                f"{low:.1%} to {high:.1%}",
                f"{fewest} of {num_runs}",
                f"{confirmed}, {len(claims) - confirmed - refuted}, {refuted}",
            ]
        )
    seeds = "seeds that confirm, do not decide, refute"
    header = ("statement", "share of all runs", "interval", "worst seed", seeds)
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


def main(arguments: Sequence[str]) -> int:
    """Run all seeds; return 1 where a seed refutes a claim, otherwise 0."""
    parsed = parse_study(_make_parser(), arguments)
    config = ExperimentConfig(
        config_folder=None,
        output_folder=parsed.out,
        setups=SETUPS,
        num_runs=parsed.runs,
        seed=0,
        num_training_frames=parsed.training_frames,
    )
    if parsed.report_only:
        results = _read_seeds(config.output_folder)
    else:
        results = _run_seeds(config, range(parsed.seeds), parsed.workers)
    _write_report(config.output_folder, results, parsed.page)
    return EXIT_FAILURE if any(result.status for result in results) else 0


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
    return _count_statements(summary)


def _count_statements(summary: Mapping[str, Any]) -> SeedResult:
    setups = summary["setups"]
    return SeedResult(
        summary["seed"],
        tuple(evaluate_claims(setups)),
        tuple(evaluate_claims(setups, UNTYPICAL_STATEMENTS)),
    )


def _read_seeds(folder: Path) -> list[SeedResult]:
    """Evaluate the summaries that an earlier command wrote, of every seed that it finished."""
    summaries = [json.loads(path.read_text("utf-8")) for path in folder.glob("seed_*/summary.json")]
    if not summaries:
        raise CatoptraError(f"{folder}: no seed_*/summary.json to report")
    return [_count_statements(each) for each in sorted(summaries, key=itemgetter("seed"))]


def _run_seeds(
    config: ExperimentConfig, seeds: Sequence[int], num_processes: int
) -> list[SeedResult]:
    results = []
    # Spawned, since a fork copies the locks of the display's thread. Leaving the block ends the
    # processes, after an error or Ctrl-C with the seeds that have not ended.
    with start_without_interrupts():
        pool = get_context("spawn").Pool(num_processes, _end_by_signal)
    with open_progress() as progress, pool:
        advance = progress.add_task("seeds", len(seeds))
        # In the order of the seeds; the first that fails ends the command.
        for result in pool.imap(partial(_evaluate_experiment, config), seeds):
            results.append(result)
            advance()
    return results


def _end_by_signal() -> None:
    """Let SIGTERM end a process and all servers of it."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())


def _write_report(folder: Path, results: Sequence[SeedResult], page: Path | None) -> None:
    report = folder / "seeds.md"
    num_runs = results[0].claims[0].runs.num_runs
    report.write_text(_format_report(results, num_runs=num_runs), encoding="utf-8")
    pooled = [claim for claim, _ in _pool_seeds(result.claims for result in results)]
    rows = [(claim.text, str(claim.runs), claim.verdict) for claim in pooled]
    print_table(("claim of the paper", "runs of all seeds", "confirmed"), rows)
    print_line(f"report: {report}")
    if page is not None:
        replace_block(page, "seeds", _format_page_block(results, num_runs))


def _format_page_block(results: Sequence[SeedResult], num_runs: int) -> str:
    """The statements of both kinds in short, for a page of the repository."""
    header = ("statement", "share of all runs", "interval of 95 %", "confirmed")
    rows = [
        [claim.text, f"{claim.runs.share:.1%}", "{:.1%} to {:.1%}".format(*claim.runs.interval),
         claim.verdict]
        for claim, _ in _pool_seeds((*result.claims, *result.untypical) for result in results)
    ]  # fmt: skip
    no_claims = len(results[0].untypical)
    extent = f"{len(results)} seeds of {num_runs} runs; the last {no_claims} are no claims:"
    return f"{extent}\n\n{markdown_table(header, rows)}"


def _make_parser() -> CommandParser:
    parser = make_parser(
        "seeds",
        "Evaluate the claims of demo with the seeds 0, 1, ..., without pictures. Fifty "
        "seeds of 20 runs take about 20 minutes on two cores. Writes seeds.md and the numbers of "
        "each seed.",
    )
    add = parser.add_argument
    add_output(parser, "out/experiment-seeds", "folder for seeds.md and a folder a seed")
    add("--seeds", type=parse_count, default=50, metavar="N", help="number of seeds, from 0")
    add("--runs", type=parse_count, default=20, metavar="N",
        help="drives for each set-up and seed")  # fmt: skip
    add("--training-frames", type=parse_count, default=30, metavar="N",
        help="frames for the classifier")  # fmt: skip
    add("--workers", type=parse_count, default=os.cpu_count() or 1, metavar="N",
        help="processes, of one seed each (default: one for each processor)")  # fmt: skip
    parser.read_too("--workers", "--processes")
    add("--report-only", action="store_true", help="drive nothing: report the seeds in DIR")
    add("--page", type=Path, metavar="FILE", help="file whose block seeds gets the short table")
    return parser
