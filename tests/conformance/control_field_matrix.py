"""The matrix of generated mutations of a control server: which checks of a tour notice each.

A tour of our own server is recorded once in each dialect; each mutation changes its lines, and the
checks look at the changed recording. Run: make mutations, or, in tests/,
`python -m conformance.control_field_matrix`.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterable
from functools import partial
from pathlib import Path

from conformance.control_field_mutations import (
    TextMutation,
    generate_line_mutations,
    generate_text_mutations,
    mutate_lines,
)
from conformance.control_tour import Tour, record_tour, record_visits
from conformance.control_tour_checks import TOUR_CHECKS, VISIT_CHECKS, find_contradiction
from conformance.control_tour_server import run_tour_server
from conformance.field_mutations import FieldMutation

MIN_NOTICED = 0.95
_ALL_CHECKS = {**TOUR_CHECKS, **VISIT_CHECKS}


def record_own_tour(folder: Path, dialect: str) -> Tour:
    """Tour of our own server, with visits of its start poses."""
    with run_tour_server(folder, dialect) as server:
        return record_visits(record_tour(server))


ControlMutation = FieldMutation | TextMutation


def find_mutations(tour: Tour) -> list[ControlMutation]:
    """All mutations of the lines of a tour."""
    lines = [line.text for line in tour.lines]
    return [*generate_line_mutations(lines), *generate_text_mutations(lines, tour.dialect)]


def judge_mutation(tour: Tour, mutation: ControlMutation) -> str | None:
    """What notices a mutation, empty for nothing; None if it changes no byte of the tour."""
    mutated = tour.map_lines(partial(mutate_lines, mutation))
    if (mutated.lines, mutated.visits) == (tour.lines, tour.visits):
        return None
    return find_contradiction(mutated, _ALL_CHECKS)


def judge_mutations(tour: Tour, mutations: Iterable[ControlMutation]) -> dict[str, str]:
    """What notices each mutation that changes something, by its name."""
    judged = {one.name: judge_mutation(tour, one) for one in mutations}
    return {name: reason for name, reason in judged.items() if reason is not None}


def main() -> int:
    """Play the matrix in both dialects; exit status."""
    is_right = True
    for dialect in ("ut2004", "udk"):
        with tempfile.TemporaryDirectory() as name:
            tour = record_own_tour(Path(name), dialect)
        reason = find_contradiction(tour, _ALL_CHECKS)
        judged = judge_mutations(tour, find_mutations(tour))
        unnoticed = [one for one, check in judged.items() if not check]
        share = 1.0 - len(unnoticed) / len(judged)
        print(f"{dialect}: unmutated {reason or 'passed'}; of {len(judged)} mutations {share:.1%}")
        print("not noticed: " + "; ".join(unnoticed))
        is_right = is_right and not reason and share >= MIN_NOTICED
    return 0 if is_right else 1


if __name__ == "__main__":
    sys.exit(main())
