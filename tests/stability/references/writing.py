"""Helpers of the reference scripts: 50 digits as text, inputs in both float types, files.

A script lists cases as (name, inputs) with the exact formula in mpmath, and calls `write`.
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
    """Case with a value: `exact` maps the inputs, as mpf, to mpf or lists."""
    row = float64_case(name, inputs, exact=exact, tolerance=tolerance)
    rounded = _round_inputs(inputs)
    if _keeps_its_kind(inputs, rounded):
        # Rounded onto a singularity, nothing of the case is left.
        with suppress(ZeroDivisionError):
            row["reference_float32"] = _digits(exact(**_exact(rounded)))
    return row


def float64_case(
    name: str, inputs: Inputs, *, exact: Callable[..., Any], tolerance: Mapping[str, Any]
) -> dict[str, Any]:
    """Case that rounding to float32 would remove: 2 + 1e-12 is 2 there."""
    mp.dps = WORKING_DIGITS
    row = {"name": name, "inputs": _encode_inputs(inputs), "expect": "value"}
    row["reference"] = _digits(exact(**_exact(inputs)))
    row["tolerance"] = dict(tolerance)
    return row


def refusal(name: str, inputs: Inputs, *, expect: str, which: str) -> dict[str, Any]:
    """Case without a value.

    expect: invalid or error; which: words of the reason.
    """
    row = {"name": name, "inputs": _encode_inputs(inputs), "expect": expect, "which": which}
    return row if _keeps_its_kind(inputs, _round_inputs(inputs)) else {**row, "float32": False}


def write(group: str, formula: str, rows: list[dict[str, Any]]) -> None:
    """Write the cases of a formula, one per line, so that a diff shows the changed cases."""
    path = CASES / group / f"{formula}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = ",\n".join(json.dumps(row, allow_nan=False) for row in rows)
    path.write_text(f"[\n{lines}\n]\n", encoding="utf-8")


def _digits(value: Any) -> Any:
    if isinstance(value, list):
        return [_digits(item) for item in value]
    return nstr(mpf(value), 50, strip_zeros=True)


def _exact(inputs: Any) -> Any:
    return _map_floats(inputs, mpf)


def _encode_inputs(inputs: Any) -> Any:
    return _map_floats(inputs, lambda x: x.hex() if math.isfinite(x) else str(x))


def _round_inputs(inputs: Any) -> Any:
    with np.errstate(all="ignore"):
        return _map_floats(inputs, lambda x: float(np.float32(x)))


def _map_floats(value: Any, function: Callable[[float], Any]) -> Any:
    """Nested inputs with a function applied to each float."""
    if isinstance(value, Mapping):
        return {key: _map_floats(item, function) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_map_floats(item, function) for item in value]
    return function(value) if isinstance(value, float) else value


def _keeps_its_kind(inputs: Any, rounded: Any) -> bool:
    """Whether rounding to float32 neither overflows nor ends in subnormals or zero."""
    if isinstance(inputs, Mapping):
        return all(_keeps_its_kind(inputs[key], rounded[key]) for key in inputs)
    if isinstance(inputs, list | tuple):
        return all(map(_keeps_its_kind, inputs, rounded))
    if not isinstance(inputs, float) or inputs == 0.0 or not math.isfinite(inputs):
        return True
    return math.isfinite(rounded) and abs(rounded) >= float(np.finfo(np.float32).tiny)
