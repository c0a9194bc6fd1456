"""The report of `catoptra-studies seeds`: shares over all runs, and the status of each seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from catoptra_studies.experiment.paper_claims import Claim
from catoptra_studies.experiment.run_share import pool_shares
from catoptra_studies.reports.markdown import markdown_table, wrap_paragraph


@dataclass(frozen=True, slots=True)
class SeedResult:
    """Statements counted over the runs of one seed."""

    seed: int

    claims: tuple[Claim, ...]
    """The paper's statements that decide the status of `demo`."""

    untypical: tuple[Claim, ...]
    """Statements of the paper that the typical run does not satisfy; they decide nothing."""

    @property
    def status(self) -> int:
        """Exit status of `demo` with this seed."""
        return 0 if all(claim.is_confirmed for claim in self.claims) else 1


def format_seeds_report(results: Sequence[SeedResult], *, num_runs: int) -> str:
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
