"""Catalogue of hard cases: the format of a case, and the check of a function against a case.

`cases/<group>/<formula>.json` is a list of cases with references of 50 digits, written by a script
in `references/` (`python -m stability.references.<script>`). `subjects/<group>.py` assigns a
function of the product, the subject, to each formula:

| key               | content                                                                    |
|-------------------|----------------------------------------------------------------------------|
| name              | the difficulty, in words                                                    |
| inputs            | by name: exact float64 as numbers or hex, "nan", "inf", lists, words        |
| expect            | value, invalid or error                                                     |
| which             | invalid, error: words that the reason or the message must have              |
| reference         | value: 50 digits as text, or lists of them                                  |
| reference_float32 | the same for inputs rounded to float32; absent where rounding leaves        |
|                   | nothing of the case (1e300 is infinite in float32)                          |
| float32           | invalid, error: false where rounding leaves nothing of the case             |
| tolerance         | by float type: rel, abs, ulp, whose largest counts, and the reason;         |
|                   | "turn": true compares angles modulo a whole turn                            |

Each case is checked twice: in float64, and in float32 with inputs and results rounded to float32.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_protocol.errors import CatoptraError

CASES = Path(__file__).parent / "cases"

_TURN = 2 * Fraction("3.14159265358979323846264338327950288419716939937510582097494")

Subject = Callable[..., Any]


class Invalid(Exception):  # noqa: N818 # a result, not an error
    """Signals that a function returned no valid value, with the reason if any."""


@dataclass(frozen=True, slots=True)
class Case:
    """One case in one float type, to which the inputs are rounded."""

    group: str
    formula: str
    name: str
    float_type: str
    inputs: Mapping[str, Any]
    expect: str
    which: str
    reference: Any
    tolerance: Mapping[str, Any]

    def __str__(self) -> str:
        return f"{self.formula}-{self.name}-{self.float_type}".replace(" ", "_")


def load(group: str) -> list[Case]:
    """All cases of a group, formula by formula."""
    files = sorted((CASES / group).glob("*.json"))
    return [case for path in files for case in _of_file(group, path)]


def check(case: Case, subjects: Mapping[str, Subject]) -> None:
    """Check a case against the subject of the case's formula; AssertionError if the case fails.

    Floating-point errors and warnings fail too. A subject without a valid value raises Invalid.
    """
    with np.errstate(all="raise"), warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            answer = subjects[case.formula](**case.inputs)
        except (Invalid, CatoptraError) as refusal:
            _check_refusal(case, refusal)
            return
        except (ArithmeticError, ValueError, Warning) as failure:  # LinAlgError is a ValueError
            raise AssertionError(f"{case}: {failure!r}") from failure
    assert case.expect == "value", f"{case}: {answer!r}, but expected {case.expect}"
    _check_value(case, answer, case.reference)


def failing_messages(group: str, subjects: Mapping[str, Subject]) -> list[str]:
    """Messages of the failing cases of a group: none for the product, some for every mutant."""
    return [text for case in load(group) if (text := _failure(case, subjects))]


def _failure(case: Case, subjects: Mapping[str, Subject]) -> str:
    try:
        check(case, subjects)
    except AssertionError as failure:
        return str(failure)
    return ""


def _check_refusal(case: Case, refusal: Exception) -> None:
    kind = "invalid" if isinstance(refusal, Invalid) else "error"
    assert case.expect == kind, f"{case}: {kind} ({refusal}), but expected {case.expect}"
    assert case.which in str(refusal), f"{case}: {str(refusal)!r} does not say {case.which!r}"


def _check_value(case: Case, answer: Any, reference: Any) -> None:
    if isinstance(reference, list):
        assert len(answer) == len(reference), f"{case}: {answer!r} has another shape"
        for got, expected in zip(answer, reference, strict=True):
            _check_value(case, got, expected)
        return
    got = float(np.float32(answer)) if case.float_type == "float32" else float(answer)
    assert math.isfinite(got), f"{case}: {got!r}, but expected {reference}"
    error, allowed = error_and_bound(case, got, reference)
    assert error <= allowed, f"{case}: {got!r} is off {reference} by {float(error):.3g}"


def error_and_bound(case: Case, got: float, reference: str) -> tuple[Fraction, Fraction]:
    """Error of a number against the reference, and the allowed error."""
    error = abs(Fraction(got) - Fraction(Decimal(reference)))
    if case.tolerance.get("turn"):
        error = abs(error - round(error / _TURN) * _TURN)
    return error, _allowed_error(case.tolerance, float(reference), case.float_type)


def _allowed_error(tolerance: Mapping[str, Any], reference: float, float_type: str) -> Fraction:
    size = abs(reference)
    spacing = math.ulp(size) if float_type == "float64" else float(np.spacing(np.float32(size)))
    kinds = {"rel": size, "abs": 1.0, "ulp": spacing}
    return max(
        Fraction(tolerance[kind] * unit) for kind, unit in kinds.items() if kind in tolerance
    )


def _of_file(group: str, path: Path) -> Iterator[Case]:
    for row in json.loads(path.read_text(encoding="utf-8")):
        yield _case(group, path.stem, row, "float64")
        of_value = row["expect"] == "value"
        if "reference_float32" in row if of_value else row.get("float32", True):
            yield _case(group, path.stem, row, "float32")


def _case(group: str, formula: str, row: Mapping[str, Any], float_type: str) -> Case:
    reference = "reference" if float_type == "float64" else "reference_float32"
    return Case(
        group,
        formula,
        row["name"],
        float_type,
        {name: _decode_input(value, float_type) for name, value in row["inputs"].items()},
        row["expect"],
        row.get("which", ""),
        row.get(reference),
        row.get("tolerance", {}).get(float_type, {}),
    )


def _decode_input(value: Any, float_type: str) -> Any:
    """Input with numbers as Python floats; integers and words stay as they are."""
    if isinstance(value, list):
        return [_decode_input(item, float_type) for item in value]
    if isinstance(value, str) and _is_number(value):
        value = float.fromhex(value)
    if not isinstance(value, float):
        return value
    with np.errstate(all="ignore"):
        return value if float_type == "float64" else float(np.float32(value))


def _is_number(text: str) -> bool:
    return text in ("nan", "inf", "-inf") or text.removeprefix("-").startswith("0x")
