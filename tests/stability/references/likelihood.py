"""Eq. 3 in rational numbers, and its histograms. 1 = a landmark colour, 0 = none."""

from __future__ import annotations

import math
from typing import Any

from mpmath import isinf, mpf

from stability.references.writing import case, float64_case, refusal, write


def accepts(n_pos: int, all_pos: int, n_neg: int, all_neg: int, theta: Any) -> Any:
    """1 where n_pos / all_pos >= theta n_neg / all_neg and n_pos is not 0."""
    if not n_pos:
        return mpf(0)
    if isinf(theta):
        return mpf(not n_neg)
    return mpf(n_pos * all_neg >= theta * n_neg * all_pos)


EXACT = {"float64": {"abs": 0.0, "reason": "integers"}, "float32": {"abs": 0.0, "reason": "same"}}
HUGE = 2**62
COUNTS = {
    "seen often": (50, 100, 1, 1000, 10.0),
    "never seen": (0, 100, 0, 1000, 10.0),
    "never seen, threshold zero": (0, 100, 0, 1000, 0.0),
    "seen elsewhere only, threshold zero": (0, 100, 5, 1000, 0.0),
    "seen once, threshold zero": (1, 100, 999, 1000, 0.0),
    "only ever on the landmark": (1, 100, 0, 1000, 1e300),
    "only ever on the landmark, threshold infinite": (1, 100, 0, 1000, math.inf),
    "once elsewhere, threshold infinite": (99, 100, 1, 1000, math.inf),
    "never seen, threshold infinite": (0, 100, 0, 1000, math.inf),
    "exactly at the threshold": (30, 100, 10, 100, 3.0),
    "a count below the threshold": (29, 100, 10, 100, 3.0),
    "a tie at a threshold with no binary fraction": (1, 100, 10, 100, 0.1),
    "a threshold an ulp below the tie": (1, 100, 10, 100, math.nextafter(0.1, 0.0)),
    "a threshold an ulp above the tie": (30, 100, 10, 100, math.nextafter(3.0, 4.0)),
    "thirds that a quotient would round": (1, 3, 1, 3, 1.0),
    "a tie that quotients round apart": (7, 49, 3, 21, 1.0),
    "a tie at 10 that quotients round apart": (10, 33, 3, 99, 10.0),
    "products beyond 64 bits, just accepted": (HUGE, HUGE, HUGE - 1, HUGE, 1.0),
    "products beyond 64 bits, just not": (HUGE - 1, HUGE, HUGE, HUGE, 1.0),
    "the smallest threshold": (1, HUGE, HUGE, HUGE, 5e-324),
    "the largest threshold": (HUGE, HUGE, 1, HUGE, 1.7e308),
}
TOTALS = {
    "nothing": [0, 0, 0],
    "a pixel": [1, 0, 0],
    "as many as fit": [2**61, 2**61, 0],
}


def main() -> None:
    """Write the cases of both groups."""
    rows = [
        (float64_case if "an ulp" in name else case)(
            name, _inputs(*numbers), exact=accepts, tolerance=EXACT
        )
        for name, numbers in COUNTS.items()
    ]
    wrong = {
        "an empty positive class": ((0, 0, 1, 100, 10.0), "no training pixel of: pos"),
        "an empty negative class": ((1, 100, 0, 0, 10.0), "no training pixel of: neg"),
        "a negative threshold": ((1, 100, 1, 100, -1.0), "theta is a ratio"),
        "a threshold that is not a number": ((1, 100, 1, 100, math.nan), "theta is a ratio"),
    }
    rows += [
        refusal(name, _inputs(*numbers), expect="error", which=which)
        for name, (numbers, which) in wrong.items()
    ]
    write("likelihood", "accepted", rows)
    _write_histograms()


def _inputs(n_pos: int, all_pos: int, n_neg: int, all_neg: int, theta: float) -> dict[str, Any]:
    counts = {"n_pos": n_pos, "all_pos": all_pos, "n_neg": n_neg, "all_neg": all_neg}
    return {**counts, "theta": theta}


def _write_histograms() -> None:
    rows = [
        case(name, {"counts": counts}, exact=lambda counts: mpf(sum(counts)), tolerance=EXACT)
        for name, counts in TOTALS.items()
    ]
    too_many = [2**62, 1, 2**62]
    wrong = {
        "a negative count": ([1, -1, 0], "integers, not negative"),
        "counts that are no integers": ([0.5, 1.0, 0.0], "integers, not negative"),
        "a total that would wrap": (too_many, "at most 2^62 pixels"),
    }
    rows += [
        refusal(n, {"counts": counts}, expect="error", which=which)
        for n, (counts, which) in wrong.items()
    ]
    write("histogram", "total", rows)
    pairs = {"two": ([1, 2, 3], [4, 5, 6]), "with nothing": ([1, 2, 3], [0, 0, 0])}
    rows = [
        case(name, {"first": a, "second": b}, exact=_merge, tolerance=EXACT)
        for name, (a, b) in pairs.items()
    ]
    full = {"first": [2**62, 0, 0], "second": [2**62, 0, 0]}
    rows.append(refusal("two full ones", full, expect="error", which="at most 2^62 pixels"))
    write("histogram", "merged", rows)
    rows = [
        case(name, {"counts": counts}, exact=_spread_total, tolerance=EXACT)
        for name, counts in {"a pixel": [1, 0, 0], "many": [2**54, 2**54, 0]}.items()
    ]
    rows.append(
        refusal("too many", {"counts": [2**57, 0, 0]}, expect="error", which="at most 2^62 pixels")
    )
    write("histogram", "spread_total", rows)


def _merge(first: list[int], second: list[int]) -> list[Any]:
    return [mpf(a + b) for a, b in zip(first, second, strict=True)]


def _spread_total(counts: list[int]) -> Any:
    return mpf(64 * sum(counts))


if __name__ == "__main__":
    main()
