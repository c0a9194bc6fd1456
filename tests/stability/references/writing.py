"""What every reference script needs: 50 digits as text, inputs in both float types, the file.

A script lists its cases as (name, inputs) with the exact formula in mpmath, and calls `write`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from mpmath import mp, mpf, nstr

CASES = Path(__file__).parents[1] / "cases"
# 1e-300 beside 1 needs 300 digits before the 50 that are kept.
WORKING_DIGITS = 700

Inputs = Mapping[str, Any]


def case(
    name: str, inputs: Inputs, *, exact: Callable[..., Any], tolerance: Mapping[str, Any]
) -> dict[str, Any]:
    """Return a case with a value: `exact` gets the inputs as mpf and returns mpf or lists."""
    row = float64_case(name, inputs, exact=exact, tolerance=tolerance)
    rounded = _rounded(inputs)
    if _keeps_its_kind(inputs, rounded):
        # Rounded onto a singularity, nothing of the case is left.
        with suppress(ZeroDivisionError):
            row["reference_float32"] = _digits(exact(**_exact(rounded)))
    return row


def float64_case(
    name: str, inputs: Inputs, *, exact: Callable[..., Any], tolerance: Mapping[str, Any]
) -> dict[str, Any]:
    """Return a case of which rounding to float32 would leave nothing: 2 + 1e-12 is 2 there."""
    mp.dps = WORKING_DIGITS
    row = {"name": name, "inputs": _encoded(inputs), "expect": "value"}
    row["reference"] = _digits(exact(**_exact(inputs)))
    row["tolerance"] = dict(tolerance)
    return row


def refusal(name: str, inputs: Inputs, *, expect: str, which: str) -> dict[str, Any]:
    """Return a case without a value. expect: invalid or error; which: words of its reason."""
    row = {"name": name, "inputs": _encoded(inputs), "expect": expect, "which": which}
    return row if _keeps_its_kind(inputs, _rounded(inputs)) else {**row, "float32": False}


def write(group: str, formula: str, rows: list[dict[str, Any]]) -> None:
    """Write the cases of a formula, one a line, so that a change shows as the lines it touches."""
    path = CASES / group / f"{formula}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = ",\n".join(json.dumps(row, allow_nan=False) for row in rows)
    path.write_text(f"[\n{lines}\n]\n", encoding="utf-8")


def _digits(value: Any) -> Any:
    if isinstance(value, list):
        return [_digits(item) for item in value]
    return nstr(mpf(value), 50, strip_zeros=True)


def _exact(inputs: Any) -> Any:
    return _mapped(inputs, mpf)


def _encoded(inputs: Any) -> Any:
    return _mapped(inputs, lambda x: x.hex() if math.isfinite(x) else str(x))


def _rounded(inputs: Any) -> Any:
    with np.errstate(all="ignore"):
        return _mapped(inputs, lambda x: float(np.float32(x)))


def _mapped(value: Any, function: Callable[[float], Any]) -> Any:
    """Return nested inputs with a function applied to each float; all else stays."""
    if isinstance(value, Mapping):
        return {key: _mapped(item, function) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_mapped(item, function) for item in value]
    return function(value) if isinstance(value, float) else value


def _keeps_its_kind(inputs: Any, rounded: Any) -> bool:
    """Return whether rounding to float32 neither overflows nor ends in subnormals or zero."""
    if isinstance(inputs, Mapping):
        return all(_keeps_its_kind(inputs[key], rounded[key]) for key in inputs)
    if isinstance(inputs, list | tuple):
        return all(map(_keeps_its_kind, inputs, rounded))
    if not isinstance(inputs, float) or inputs == 0.0 or not math.isfinite(inputs):
        return True
    return math.isfinite(rounded) and abs(rounded) >= float(np.finfo(np.float32).tiny)
