"""Gate, interval and NEES: chi-square quantiles by root finding on the exact distribution."""

from __future__ import annotations

import math
from typing import Any

from mpmath import erfc, findroot, gammainc, log, matrix, mp, mpf, sqrt

from catoptra_client.localization import ValidationGate, chi_square_mean_interval
from stability.references.angles import PI, wrap
from stability.references.motion import relative
from stability.references.writing import case, float64_case, refusal, write


def threshold(dof: int, false_rejection_rate: Any) -> Any:
    """Chi-square quantile that true measurements exceed at this rate."""
    if dof == 2:
        return -2 * log(false_rejection_rate)
    with mp.workdps(60):
        near = ValidationGate(float(false_rejection_rate)).threshold(1)
        return findroot(lambda x: log(erfc(sqrt(x / 2)) / false_rejection_rate), mpf(near))


def interval(dof: int, num_runs: int, confidence: Any) -> list[Any]:
    """Both ends of the mean's interval."""
    total_dof = dof * num_runs
    near = chi_square_mean_interval(dof, num_runs, confidence=float(confidence))
    with mp.workdps(60):
        tails = (1 - confidence) / 2, (1 + confidence) / 2
        return [
            findroot(
                lambda x, q=q: gammainc(mpf(total_dof) / 2, 0, x / 2, regularized=True) / q - 1,
                mpf(start * num_runs),
            )
            / num_runs
            for q, start in zip(tails, near, strict=True)
        ]


def nees(mean: Any, covariance: Any, truth: Any) -> Any:
    """E^T P^-1 e with a wrapped heading."""
    e = matrix([mean[0] - truth[0], mean[1] - truth[1], wrap(mean[2] - truth[2])])
    return (e.T * matrix(covariance) ** -1 * e)[0]


def diagonal(*variances: float) -> list[list[float]]:
    """Covariance without correlations."""
    return [[v if i == j else 0.0 for j in range(3)] for i, v in enumerate(variances)]


TIGHT = [[1.0, 0.99999, 0.0], [0.99999, 1.0, 0.0], [0.0, 0.0, 1.0]]
NEES = {
    "at the truth": ([1.0, 2.0, 3.0], diagonal(0.01, 0.01, 0.01), [1.0, 2.0, 3.0]),
    "heading across the seam": ([0.0, 0.0, PI - 0.01], diagonal(1.0, 1.0, 1e-4), [0.1, 0.0, -3.1]),
    "unequal units": ([0.0, 0.0, 0.0], diagonal(1e-30, 1e20, 1.0), [1e-15, 1e10, 1.0]),
    "a tiny covariance": ([0.0, 0.0, 0.0], diagonal(1e-300, 1e-300, 1e-300), [1e-150, 0.0, 0.0]),
    "nearly singular": ([0.0, 0.0, 0.0], TIGHT, [0.5, -0.5, 0.1]),
}
NO_NEES = {
    "certain": (diagonal(0.0, 0.0, 0.0), [0.0, 0.0, 0.0]),
    "of rank two": (diagonal(1.0, 1.0, 0.0), [0.0, 0.0, 0.0]),
    "of rank one": ([[1.0] * 3] * 3, [0.0, 0.0, 0.0]),
    "below full precision": (diagonal(1e-318, 1e-318, 1e-318), [0.0, 0.0, 0.0]),
    "too large": (diagonal(1e-200, 1.0, 1.0), [1e200, 0.0, 0.0]),
}


def main() -> None:
    """Write the cases of the group."""
    _write_gate()
    _write_interval()
    # 1 / (1 - 0.99999) of rounding at worst.
    near = relative(1e-10, "rounding times the condition of the correlations")
    rows = [
        (float64_case if n == "nearly singular" else case)(
            n, {"mean": m, "covariance": P, "truth": t}, exact=nees, tolerance=near
        )
        for n, (m, P, t) in NEES.items()
    ]
    rows += [
        refusal(
            n, {"mean": [0.0, 0.0, 0.0], "covariance": P, "truth": t}, expect="invalid", which=""
        )
        for n, (P, t) in NO_NEES.items()
    ]
    rows.append(
        refusal(
            "a truth that is not a number",
            {
                "mean": [0.0, 0.0, 0.0],
                "covariance": diagonal(1.0, 1.0, 1.0),
                "truth": [math.nan, 0.0, 0.0],
            },
            expect="error",
            which="true pose",
        )
    )
    write("trust", "nees", rows)


def _write_gate() -> None:
    rates = [0.01, 0.5, 0.999999, 1e-10, 1e-300, 5e-324]
    near = relative(1e-12, "the quantile's own rational functions")
    rows = [
        case(
            f"{rate:g} with {dof} dof",
            {"dof": dof, "false_rejection_rate": rate},
            exact=threshold,
            # Half of the smallest number is none; near 1 the quantile of dof 1 is near 0.
            tolerance=relative(2e-3, "half of the smallest number rounds")
            if rate < 1e-320
            else near,
        )
        for dof in (1, 2)
        for rate in rates
    ]
    for name, rate in (("one", 1.0), ("negative", -0.01), ("not a number", math.nan)):
        inputs = {"dof": 2, "false_rejection_rate": rate}
        rows.append(refusal(name, inputs, expect="error", which="a rejection rate"))
    rows.append(
        refusal(
            "3 degrees of freedom",
            {"dof": 3, "false_rejection_rate": 0.01},
            expect="error",
            which="1 or 2 degrees of freedom",
        )
    )
    write("trust", "threshold", rows)


def _write_interval() -> None:
    settings = [
        *((3, 50, 0.95), (2, 50, 0.95), (3, 100, 0.95), (2, 100, 0.95), (1, 1, 0.95)),
        *((2, 1, 0.99), (3, 334, 0.95), (3, 100000, 0.95), (1, 1, 0.999999), (3, 50, 1e-6)),
    ]
    rows = [
        float64_case(
            f"{dof} x {num_runs} at {confidence:g}",
            {"dof": dof, "num_runs": num_runs, "confidence": confidence},
            exact=interval,
            tolerance=relative(2e-6, "Wilson and Hilferty above 1000 freedoms"),
        )
        for dof, num_runs, confidence in settings
    ]
    wrong = {"no run": (3, 0, 0.95), "certainty": (3, 50, 1.0), "not a number": (3, 50, math.nan)}
    rows += [
        refusal(
            n,
            {"dof": dof, "num_runs": num_runs, "confidence": c},
            expect="error",
            which="no interval",
        )
        for n, (dof, num_runs, c) in wrong.items()
    ]
    write("trust", "interval", rows)


if __name__ == "__main__":
    main()
