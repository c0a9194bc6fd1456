"""EKF: P or R zero, tiny, huge, of low rank; exact sensors; landmarks repeated, in line, close.

Each case gives the expected sigmas (relative) and correlations (absolute).
"""

from __future__ import annotations

import math
from typing import Any

from mpmath import matrix

from stability.references.exact_filter import correlations, predict_exactly, sigmas, update_exactly
from stability.references.writing import case, float64_case, refusal, write

POSE = [0.2, -0.1, 0.5]
ZERO = [[0.0] * 3] * 3
MARKS = [(2.0, 1.0), (-1.0, 2.5), (0.5, -2.0), (-2.0, -0.5)]


def diagonal(*variances: float) -> list[list[float]]:
    """Covariance without correlations."""
    return [[v if i == j else 0.0 for j in range(3)] for i, v in enumerate(variances)]


def outer(a: float, b: float, c: float) -> list[list[float]]:
    """Covariance of rank one, from powers of two and therefore exact."""
    return [[p * q for q in (a, b, c)] for p in (a, b, c)]


def some(scale: float = 1.0) -> list[list[float]]:
    """Ordinary covariance with correlations, times a scale."""
    return [
        [0.09 * scale, 0.03 * scale, 0.015 * scale],
        [0.03 * scale, 0.05 * scale, -0.015 * scale],
        [0.015 * scale, -0.015 * scale, 0.0225 * scale],
    ]


def measurement_row(
    mark: tuple[float, float],
    *,
    noise: tuple[float, float] = (0.04, 0.002),
    off: tuple[float, float] = (0.0, 0.0),
    pose: list[float] = POSE,
) -> list[float]:
    """Measurement of a landmark from a pose: the predicted one plus an offset."""
    dx, dy = mark[0] - pose[0], mark[1] - pose[1]
    bearing = math.atan2(dy, dx) - pose[2] + off[1]
    return [*mark, math.hypot(dx, dy) + off[0], bearing, noise[0], 0.0, noise[1]]


def around(noise: float, times: int = 1) -> list[list[float]]:
    """Repeated measurements of all four landmarks with equally small noise."""
    return [measurement_row(mark, noise=(noise, noise)) for mark in MARKS * times]


BACK = [0.0, 0.0, 3.1]
UPDATES = {
    "an ordinary one": (POSE, some(), [measurement_row(MARKS[0], off=(0.1, 0.02))]),
    "covariance zero": (POSE, ZERO, [measurement_row(MARKS[0], off=(0.1, 0.02))]),
    "covariance 1e-20": (POSE, some(1e-20), [measurement_row(MARKS[0], off=(0.1, 0.02))]),
    "covariance 1e-300": (POSE, some(1e-300), [measurement_row(MARKS[0], off=(0.1, 0.02))]),
    "covariance 1e6": (POSE, some(1e6), [measurement_row(MARKS[0], off=(0.1, 0.02))]),
    "covariance of rank one": (POSE, outer(0.25, 0.125, 0.0625), [measurement_row(MARKS[0])]),
    "position certain, heading not": (POSE, diagonal(0.0, 0.0, 0.01), [measurement_row(MARKS[0])]),
    "heading certain, position not": (POSE, diagonal(0.01, 0.01, 0.0), [measurement_row(MARKS[0])]),
    "metres beside microradians": (POSE, diagonal(1e4, 1e4, 1e-12), [measurement_row(MARKS[0])]),
    "noise 1e-10": (POSE, some(), around(1e-10)),
    "noise 1e-14": (POSE, some(), around(1e-14)),
    "noise 1e-14, heading certain": (POSE, diagonal(1.0, 1.0, 0.0), around(1e-14)[:1]),
    "a position known to 1 km seen to 10 um": (POSE, diagonal(1e6, 1e6, 0.0), around(1e-10)[:1]),
    "noise 1e-300": (POSE, some(), [measurement_row(MARKS[0], noise=(1e-300, 1e-300))]),
    "noise zero": (POSE, some(), [measurement_row(MARKS[0], noise=(0.0, 0.0))]),
    "noise 1e12": (POSE, some(), around(1e12)),
    "range exact, bearing useless": (POSE, some(), [measurement_row(MARKS[0], noise=(1e-14, 1e8))]),
    "bearing exact, range useless": (POSE, some(), [measurement_row(MARKS[0], noise=(1e8, 1e-14))]),
    "the same thing fifty times": (POSE, some(), [measurement_row(MARKS[0])] * 50),
    "exact, the same thing twenty times": (
        POSE,
        some(),
        [measurement_row(MARKS[0], noise=(1e-12, 1e-12))] * 20,
    ),
    "exact, all around, ten times": (POSE, some(), around(1e-12, 10)),
    "two landmarks in line": (
        POSE,
        some(),
        [measurement_row((2.2, -0.1)), measurement_row((4.2, -0.1))],
    ),
    "two exact landmarks in line": (
        POSE,
        some(),
        [
            measurement_row((2.2, -0.1), noise=(1e-10, 1e-10)),
            measurement_row((4.2, -0.1), noise=(1e-10, 1e-10)),
        ],
    ),
    "two landmarks on either side": (
        POSE,
        some(),
        [measurement_row((2.2, -0.1)), measurement_row((-1.8, -0.1))],
    ),
    "a landmark behind, across the seam": (
        [0.0, 0.0, 0.0],
        some(),
        [measurement_row((-2.0, -0.02), off=(0.0, 0.04), pose=[0.0, 0.0, 0.0])],
    ),
    "a heading corrected across the seam": (
        BACK,
        some(),
        [measurement_row((-2.0, 0.0), off=(0.0, -0.2), pose=BACK)],
    ),
    "a landmark at 6 cm": (POSE, some(1e-4), [measurement_row((0.26, -0.1))]),
    "a landmark at 1e6 m": (POSE, some(), [measurement_row((1e6, 1.0), off=(0.1, 0.02))]),
    "a landmark at 1e100 m": (POSE, some(), [measurement_row((1e100, 1.0))]),
}
# How exact a result can be: rounding in units of the prior, seen at the size of the posterior.
SIGMA_RELATIVE = {
    "noise 1e-10": 1e-5,
    "noise 1e-14": 1e-2,
    "noise 1e-14, heading certain": 1e-9,
    "a position known to 1 km seen to 10 um": 1e-9,
    "noise 1e-300": 1e-11,
    "noise zero": 1e-11,
    "exact, the same thing twenty times": 1e-9,
    "exact, all around, ten times": 1e-2,
    "two exact landmarks in line": 1e-7,
    "metres beside microradians": 1e-9,
}
# How exact the pose can be: a range is rounded at its own size, which the innovation inherits.
POSE_ABSOLUTE = {"a landmark at 1e6 m": 2e-10, "a landmark at 1e100 m": None}
ALPHAS = [0.01, 0.001, 0.0005, 0.0064]
PREDICTIONS = {
    "straight on": (POSE, some(), 0.2, 0.0, ALPHAS),
    "from certainty": (POSE, ZERO, 0.2, 0.1, ALPHAS),
    "a tiny turn": (POSE, some(), 0.2, 1e-12, ALPHAS),
    "a turn on the spot": (POSE, some(), 0.0, 1.0, ALPHAS),
    "backwards": (POSE, some(), -0.2, 0.1, ALPHAS),
    "without noise": (POSE, some(), 0.2, 0.1, [0.0] * 4),
    "without noise, of rank one": (POSE, outer(0.25, 0.125, 0.0625), 0.2, 0.1, [0.0] * 4),
    "standing still": (POSE, some(), 0.0, 0.0, ALPHAS),
    "standing still, certain": (POSE, ZERO, 0.0, 0.0, ALPHAS),
    "covariance 1e-300": (POSE, some(1e-300), 0.0, 1e-3, [0.0] * 4),
    "covariance 1e200": (POSE, some(1e200), 0.2, 0.1, ALPHAS),
    "a step of 1e50 m": (POSE, some(), 1e50, 0.1, ALPHAS),
    "a step of 1e-100 m": (POSE, ZERO, 1e-100, 0.1, ALPHAS),
    "a step of 1e-200 m": (POSE, some(), 1e-200, 0.0, ALPHAS),
}


# Entries next to those of singular matrices are exact in binary.
ROOTS = {
    "zero": ZERO,
    "equal eigenvalues": diagonal(1.0, 1.0, 1.0),
    "eigenvalues equal up to rounding": [
        [1.0, 2.0**-52, 0.0],
        [2.0**-52, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ],
    "rank one": outer(0.25, 0.125, 0.0625),
    "rank one, with signs": outer(0.25, -0.125, 0.0625),
    "rank two": [[1.0, 0.5, 0.5], [0.5, 0.5, 0.25], [0.5, 0.25, 0.25]],
    "two alike, told apart by the third only": [
        [1.0, 1.0, 0.5],
        [1.0, 1.0, 0.5 + 2.0**-28],
        [0.5, 0.5 + 2.0**-28, 1.0],
    ],
    "correlations next to one": [
        [1.0, 1.0 - 2.0**-50, 0.0],
        [1.0 - 2.0**-50, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ],
    "a certain first one": diagonal(0.0, 4.0, 0.25),
    "metres beside nanoradians": [[1e6, 1e-7, 0.0], [1e-7, 1e-18, 0.0], [0.0, 0.0, 1.0]],
    "of 1e300": some(1e300),
    "of 1e-300": some(1e-300),
    "next to the smallest normal float": some(1e-305),
}


def _tolerance(rel: float) -> dict[str, Any]:
    reason = f"rounding of the prior at the posterior's size: {rel:g}"
    return {
        "float64": {"rel": rel, "abs": 5e-324, "reason": reason},
        "float32": {"rel": rel + 2e-7, "abs": 1e-45, "reason": f"{reason}; rounded to float32"},
    }


def _absolute(size: float) -> dict[str, Any]:
    return {
        "float64": {"abs": size, "turn": True, "reason": "of one, and of the sigmas' error"},
        "float32": {"abs": size + 2e-7, "turn": True, "reason": "the same, rounded to float32"},
    }


def main() -> None:
    """Write the cases of the group."""
    _write_updates()
    _write_predictions()
    _write_roots()
    _write_refusals()


def _write_updates() -> None:
    files: dict[str, list[Any]] = {"updated_sigmas": [], "updated_pose": []}
    files["updated_correlations"] = []
    for name, (mean, covariance, rows) in UPDATES.items():
        inputs = {"mean": mean, "covariance": covariance, "seen": rows}
        rel = SIGMA_RELATIVE.get(name, 1e-12)
        # In float32 an exact sensor contradicts itself: innovations of rounding, not of the case.
        make = float64_case if rel > 1e-12 else case
        pose = POSE_ABSOLUTE.get(name, 1e-13)
        if pose is not None:
            files["updated_pose"].append(
                make(name, inputs, exact=_updated_pose, tolerance=_absolute(pose))
            )
        files["updated_sigmas"].append(
            make(name, inputs, exact=_updated_sigmas, tolerance=_tolerance(rel))
        )
        files["updated_correlations"].append(
            make(name, inputs, exact=_updated_correlations, tolerance=_absolute(rel))
        )
    for formula, cases in files.items():
        write("ekf", formula, cases)


def _updated_pose(mean: Any, covariance: Any, seen: Any) -> Any:
    return update_exactly(mean, covariance, seen)[0]


def _updated_sigmas(mean: Any, covariance: Any, seen: Any) -> Any:
    return sigmas(update_exactly(mean, covariance, seen)[1])


def _updated_correlations(mean: Any, covariance: Any, seen: Any) -> Any:
    return correlations(update_exactly(mean, covariance, seen)[1])


def _write_predictions() -> None:
    files: dict[str, list[Any]] = {"predicted_sigmas": [], "predicted_correlations": []}
    for name, (mean, covariance, v, turn, alphas) in PREDICTIONS.items():
        inputs = {"mean": mean, "covariance": covariance, "v": v, "turn": turn, "alphas": alphas}
        files["predicted_sigmas"].append(
            case(name, inputs, exact=_predicted_sigmas, tolerance=_tolerance(1e-13))
        )
        files["predicted_correlations"].append(
            case(name, inputs, exact=_predicted_correlations, tolerance=_absolute(1e-12))
        )
    for formula, cases in files.items():
        write("ekf", formula, cases)


def _predicted_sigmas(**inputs: Any) -> Any:
    return sigmas(predict_exactly(**inputs)[1])


def _predicted_correlations(**inputs: Any) -> Any:
    return correlations(predict_exactly(**inputs)[1])


def _write_roots() -> None:
    exact = {
        "root_sigmas": lambda covariance: sigmas(matrix(covariance)),
        "root_correlations": lambda covariance: correlations(matrix(covariance)),
    }
    for formula, function in exact.items():
        tolerance = _tolerance(1e-15) if formula == "root_sigmas" else _absolute(1e-14)
        rows = [
            float64_case(name, {"covariance": P}, exact=function, tolerance=tolerance)
            for name, P in ROOTS.items()
        ]
        write("ekf", formula, rows)


NAN, INF = math.nan, math.inf
NOT_USED = {
    "a range that is not a number": ([2.0, 1.0, NAN, 0.0, 0.04, 0.0, 0.002], "not finite"),
    "an infinite range": ([2.0, 1.0, INF, 0.0, 0.04, 0.0, 0.002], "not finite"),
    "a bearing that is not a number": ([2.0, 1.0, 2.0, NAN, 0.04, 0.0, 0.002], "not finite"),
    "an infinite bearing": ([2.0, 1.0, 2.0, -INF, 0.04, 0.0, 0.002], "not finite"),
    "a noise that is not a number": ([2.0, 1.0, 2.0, 0.0, NAN, 0.0, 0.002], "not finite"),
    "an infinite noise": ([2.0, 1.0, 2.0, 0.0, 0.04, 0.0, INF], "not finite"),
    "a negative variance": ([2.0, 1.0, 2.0, 0.0, -0.04, 0.0, 0.002], "not positive semidefinite"),
    "a correlation above one": ([2.0, 1.0, 2.0, 0.0, 0.04, 0.1, 0.04], "not positive"),
    "a covariance beside no variance": ([2.0, 1.0, 2.0, 0.0, 0.0, 0.1, 0.04], "not positive"),
    "a correlation that overflows": ([2.0, 1.0, 2.0, 0.0, 1e-300, 1e300, 1.0], "not positive"),
    "a landmark at the robot": ([0.2, -0.1, 0.0, 0.0, 0.04, 0.0, 0.002], "at the believed"),
    "a landmark 4 cm off": ([0.24, -0.1, 0.04, 0.0, 0.04, 0.0, 0.002], "at the believed"),
    "a range of 1e200": ([2.0, 1.0, 1e200, 0.0, 0.04, 0.0, 0.002], "too large"),
    "a noise at the end of float64": ([2.0, 1.0, 2.0, 0.0, 1.7e308, 0.0, 1.7e308], ""),
}


def _write_refusals() -> None:
    cases = [
        refusal(
            name, {"mean": POSE, "covariance": some(), "seen": [row]}, expect="invalid", which=which
        )
        for name, (row, which) in NOT_USED.items()
        if which
    ]
    certain = {
        "mean": POSE,
        "covariance": ZERO,
        "seen": [measurement_row(MARKS[0], noise=(0.0, 0.0))],
    }
    cases.append(refusal("two certainties", certain, expect="invalid", which="both certain"))
    exact = {"mean": POSE, "covariance": some(), "seen": around(1e-18)}
    cases.append(refusal("noise below rounding", exact, expect="invalid", which="both certain"))
    write("ekf", "refused", cases)
    wrong = {
        "not a number": ([[NAN, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "finite"),
        "infinite": (diagonal(1.0, INF, 1.0), "finite"),
        "a negative variance": (diagonal(1.0, -1e-9, 1.0), "negative variance"),
        "indefinite": ([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "negative variance"),
        "indefinite beside two that are alike": (
            [[1.0, 1.0, 1e-5], [1.0, 1.0, -1e-5], [1e-5, -1e-5, 1.0]],
            "negative variance",
        ),
        "not symmetric": ([[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "symmetric"),
        "a tiny indefinite one": (
            [[1e-20, 2e-20, 0.0], [2e-20, 1e-20, 0.0], [0.0, 0.0, 1e-20]],
            "negative variance",
        ),
    }
    rows = [
        refusal(name, {"mean": POSE, "covariance": P}, expect="error", which=which)
        for name, (P, which) in wrong.items()
    ]
    rows.append(
        refusal(
            "a mean that is not a number",
            {"mean": [NAN, 0.0, 0.0], "covariance": ZERO},
            expect="error",
            which="finite",
        )
    )
    write("ekf", "belief", rows)
    steps = {
        "a step of 1e100 m": (1e100, 0.1),
        "a step of 1e200 m": (1e200, 0.0),
        "a turn of 1e200": (0.1, 1e200),
    }
    rows = [
        refusal(
            name,
            {"mean": POSE, "covariance": some(), "v": v, "turn": turn, "alphas": ALPHAS},
            expect="error",
            which="leads beyond float64",
        )
        for name, (v, turn) in steps.items()
    ]
    write("ekf", "predicted", rows)


if __name__ == "__main__":
    main()
