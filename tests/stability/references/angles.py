"""Angles: wrapping, differences and interpolation, with 2 pi to 50 digits."""

from __future__ import annotations

import math
from typing import Any

from mpmath import ceil, pi

from stability.references.writing import case, refusal, write

PI = math.pi


def wrap(angle: Any) -> Any:
    """Angle in (-pi, pi]."""
    return angle - 2 * pi * ceil((angle - pi) / (2 * pi))


def difference(angle: Any, start: Any) -> Any:
    """Turn from start to angle."""
    return wrap(angle - start)


def between(start: Any, end: Any, fraction: Any) -> Any:
    """Angle at a fraction of the shorter turn."""
    return wrap(start + fraction * difference(end, start))


def tolerance(*angles: float) -> dict[str, Any]:
    """Tolerance: rounding of a result up to pi, and 2 pi as a float in each turn."""
    turns = 4e-17 * sum(map(abs, angles))
    reason = "an ulp of pi, and what fl(2 pi) differs from 2 pi over the turns"
    return {
        "float64": {"abs": 9e-16 + turns, "turn": True, "reason": reason},
        "float32": {"abs": 2.4e-7 + turns, "turn": True, "reason": "half an ulp of pi in float32"},
    }


WRAPPED = {
    "zero": 0.0,
    "the smallest number": 5e-324,
    "a tiny angle": -1e-300,
    "pi": PI,
    "minus pi": -PI,
    "just beyond pi": math.nextafter(PI, 4.0),
    "just above minus pi": math.nextafter(-PI, 0.0),
    "one turn": 2 * PI,
    "just short of a turn": math.nextafter(2 * PI, 0.0),
    "three half turns": 3 * PI,
    "minus five half turns": -5 * PI,
    "a million turns and a quarter": 2e6 * PI + 0.25,
    "1e15 rad": 1e15,
}
DIFFERENCES = {
    "equal": (0.3, 0.3),
    "neighbours": (math.nextafter(3.0, 4.0), 3.0),
    "across the seam": (-3.14, 3.14),
    "across the seam backwards": (3.14, -3.14),
    "pi and minus pi": (PI, -PI),
    "opposite": (PI / 2, -PI / 2),
    "tiny beside zero": (1e-300, 0.0),
    "a turn apart": (0.1 + 2 * PI, 0.1),
    "neighbours a thousand turns out": (2000 * PI + 1e-9, 2000 * PI),
    "huge against small": (1e6, -1e-6),
}
BETWEEN = {
    "mean of neighbours": (0.1, 0.2, 0.5),
    "mean across the seam": (3.1, -3.0, 0.5),
    "mean across the seam lands on it": (3.0, -3.0, 0.5),
    "mean of equal angles": (-2.0, -2.0, 0.5),
    "a third of the way back over the seam": (-3.1, 3.0, 1.0 / 3.0),
    "nothing of the way": (3.1, -3.1, 0.0),
    "a turn apart": (0.1 + 2 * PI, 0.2, 0.5),
}


def main() -> None:
    """Write the cases of the group."""
    not_finite = [("infinite", math.inf), ("not a number", math.nan)]
    rows = [
        case(name, {"angle": x}, exact=wrap, tolerance=tolerance(x)) for name, x in WRAPPED.items()
    ]
    rows += [
        refusal(n, {"angle": x}, expect="error", which="an angle must be finite")
        for n, x in not_finite
    ]
    write("angles", "wrap", rows)
    rows = [
        case(n, {"angle": a, "start": b}, exact=difference, tolerance=tolerance(a, b))
        for n, (a, b) in DIFFERENCES.items()
    ]
    rows += [
        refusal(n, {"angle": 0.0, "start": x}, expect="error", which="an angle must be finite")
        for n, x in not_finite
    ]
    write("angles", "difference", rows)
    rows = [
        case(n, {"start": a, "end": b, "fraction": s}, exact=between, tolerance=tolerance(a, b))
        for n, (a, b, s) in BETWEEN.items()
    ]
    rows.append(
        refusal(
            "an end is not a number",
            {"start": 0.0, "end": math.nan, "fraction": 0.5},
            expect="error",
            which="an angle must be finite",
        )
    )
    write("angles", "between", rows)


if __name__ == "__main__":
    main()
