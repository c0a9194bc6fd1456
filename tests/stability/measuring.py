"""Errors of the product's functions, and of the mutants, on every case; for the report."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any
from unittest.mock import patch

import numpy as np

from catoptra_protocol.errors import CatoptraError
from stability.catalogue import CASES, Case, Invalid, Subject, error_and_bound, load
from stability.mutations import Mutation, all_mutations, subjects_of


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one case.

    Of a list of numbers the one with the largest error counts.
    """

    case: Case
    got: str
    """Number or message, as text."""
    reference: str
    """Reference, as text; empty without a number."""
    error: float
    """Distance from the reference; inf without a number."""
    allowed: float
    """Allowed error."""
    error_fraction: float
    """Error over allowed error; 0 for an expected rejection, inf for a missing one."""

    @property
    def relative_error(self) -> float:
        """Error over the reference; the error itself for a reference of 0."""
        size = abs(float(self.reference)) if self.reference else 0.0
        return self.error / size if size else self.error


@dataclass(frozen=True, slots=True)
class MutantResult:
    """Worst case of a mutant, the product on the same case, and the number of failing cases."""

    mutation: Mutation
    worst: Outcome
    ours: Outcome
    failing: int


def groups() -> list[str]:
    """Groups that have cases."""
    return sorted(path.name for path in CASES.iterdir())


def evaluate_group(group: str) -> list[Outcome]:
    """Outcomes of all cases of a group."""
    subjects = subjects_of(group)
    return [evaluate_case(case, subjects) for case in load(group)]


def evaluate_mutants() -> Iterator[MutantResult]:
    """Yield every mutant with its worst case, among cases with a value if possible."""
    for mutation in all_mutations():
        ours = evaluate_group(mutation.group)
        with patch(mutation.target, mutation.mutant):
            mutant = evaluate_group(mutation.group)
        failing = [pair for pair in zip(mutant, ours, strict=True) if pair[0].error_fraction > 1.0]
        if failing:
            yield MutantResult(mutation, *max(failing, key=_showing), len(failing))


def _showing(pair: tuple[Outcome, Outcome]) -> tuple[bool, bool, float]:
    """Sort key of failures: wrong numbers before missing ones, the largest error first.

    Cases with a reference near 0, where the product is only absolutely exact, come last.
    """
    mutant, ours = pair
    finite = mutant.case.expect == "value" and math.isfinite(mutant.relative_error)
    return finite, ours.relative_error < 1e-3, mutant.relative_error if finite else 0.0


def evaluate_case(case: Case, subjects: Mapping[str, Subject]) -> Outcome:
    """Outcome of one case."""
    kind, answer = _call_subject(case, subjects)
    if kind != case.expect:
        return Outcome(case, f"{kind}: {answer}", "", math.inf, 0.0, math.inf)
    if kind != "value":
        share = 0.0 if case.which in str(answer) else math.inf
        return Outcome(case, str(answer), "", 0.0, 0.0, share)
    return max(_numbers(case, answer, case.reference), key=lambda outcome: outcome.error_fraction)


def _call_subject(case: Case, subjects: Mapping[str, Subject]) -> tuple[str, Any]:
    with np.errstate(all="raise"), warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return "value", subjects[case.formula](**case.inputs)
        except (Invalid, CatoptraError) as refusal:
            return "invalid" if isinstance(refusal, Invalid) else "error", refusal
        except (ArithmeticError, AssertionError, ValueError, Warning) as failure:
            return "failure", failure


def _numbers(case: Case, answer: Any, reference: Any) -> Iterator[Outcome]:
    if isinstance(reference, list):
        for got, expected in zip(answer, reference, strict=True):
            yield from _numbers(case, got, expected)
        return
    with np.errstate(all="ignore"):
        number = np.float32(answer) if case.float_type == "float32" else np.float64(answer)
    got, text = float(number), str(number)
    if not math.isfinite(got):
        yield Outcome(case, text, reference, math.inf, 0.0, math.inf)
        return
    error, allowed = error_and_bound(case, got, reference)
    share = _as_float(error / allowed) if allowed else (math.inf if error else 0.0)
    yield Outcome(case, text, reference, _as_float(error), float(allowed), share)


def _as_float(value: Fraction) -> float:
    """Nearest float; inf for a mutant's error ratio beyond float64."""
    return float(value) if value < sys.float_info.max else math.inf
