"""What a function of ours, or a naive form in its place, makes of every case: for the report."""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from catoptra_protocol.errors import CatoptraError
from stability.catalogue import CASES, Case, Invalid, Subject, error_and_bound, load
from stability.mutations import Mutation, all_mutations, subjects_of

TESTS = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a case. got, reference: of the number that is farthest off, as text.

    error: its distance from the reference, inf where there is no number. share: of what is allowed;
    0 for what is refused as it should be, inf for what is not.
    """

    case: Case
    got: str
    reference: str
    error: float
    allowed: float
    share: float

    @property
    def relative_error(self) -> float:
        """Return the error over the reference, the error itself where that is 0."""
        size = abs(float(self.reference)) if self.reference else 0.0
        return self.error / size if size else self.error


@dataclass(frozen=True, slots=True)
class Naive:
    """A naive form's worst case, and ours on the same; how many cases fail with it."""

    mutation: Mutation
    worst: Outcome
    ours: Outcome
    failing: int


def groups() -> list[str]:
    """Return the groups that have cases and a test module."""
    return sorted(p.name for p in CASES.iterdir() if (TESTS / f"test_{p.name}.py").is_file())


def outcomes(group: str) -> list[Outcome]:
    """Return what comes of all cases of a group."""
    subjects = subjects_of(group)
    return [measured(case, subjects) for case in load(group)]


def naive_forms() -> Iterator[Naive]:
    """Yield every naive form with the case that shows it worst, of those that have a value."""
    for mutation in all_mutations():
        ours = outcomes(mutation.group)
        with patch(mutation.target, mutation.naive):
            naive = outcomes(mutation.group)
        failing = [pair for pair in zip(naive, ours, strict=True) if pair[0].share > 1.0]
        if failing:
            yield Naive(mutation, *max(failing, key=_showing), len(failing))


def _showing(pair: tuple[Outcome, Outcome]) -> tuple[bool, bool, float]:
    """Return the order of failures: wrong numbers before none, the most wrong first.

    Where the reference is next to 0, and so ours is only absolutely right, little is shown.
    """
    naive, ours = pair
    finite = naive.case.expect == "value" and math.isfinite(naive.relative_error)
    return finite, ours.relative_error < 1e-3, naive.relative_error if finite else 0.0


def measured(case: Case, subjects: Mapping[str, Subject]) -> Outcome:
    """Return what comes of a case."""
    kind, answer = _answered(case, subjects)
    if kind != case.expect:
        return Outcome(case, f"{kind}: {answer}", "", math.inf, 0.0, math.inf)
    if kind != "value":
        share = 0.0 if case.which in str(answer) else math.inf
        return Outcome(case, str(answer), "", 0.0, 0.0, share)
    return max(_numbers(case, answer, case.reference), key=lambda outcome: outcome.share)


def _answered(case: Case, subjects: Mapping[str, Subject]) -> tuple[str, Any]:
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
    """Return the nearest double; a naive form's error over what is allowed may be beyond all."""
    return float(value) if value < sys.float_info.max else math.inf
