"""The motion model by the circle through the start, of radius v / turn; straight where turn = 0."""

from __future__ import annotations

import math
from typing import Any

from mpmath import cos, mp, mpf, sin

from stability.references.angles import wrap
from stability.references.writing import case, refusal, write


def move_along_circle(pose: Any, v: Any, turn: Any) -> list[Any]:
    """x', y' and the heading, not wrapped."""
    x, y, phi = pose
    if not turn:
        return [x + v * cos(phi), y + v * sin(phi), phi]
    radius = v / turn
    return [
        x + radius * (sin(phi + turn) - sin(phi)),
        y - radius * (cos(phi + turn) - cos(phi)),
        phi + turn,
    ]


def position(pose: Any, v: Any, turn: Any) -> list[Any]:
    """x', y'."""
    return move_along_circle(pose, v, turn)[:2]


def heading(pose: Any, v: Any, turn: Any) -> Any:
    """phi' in (-pi, pi]."""
    return wrap(move_along_circle(pose, v, turn)[2])


def ratio(a: Any) -> Any:
    """S = sin(a) / a."""
    return sin(a) / a if a else mpf(1)


def slope(a: Any) -> Any:
    """S' = (a cos(a) - sin(a)) / a^2."""
    with mp.workdps(1400):
        return (a * cos(a) - sin(a)) / a**2 if a else mpf(0)


def by_pose(pose: Any, v: Any, turn: Any) -> list[Any]:
    """Third column of G: the derivative of x', y' by phi."""
    x, y, _ = pose
    new = move_along_circle(pose, v, turn)
    return [y - new[1], new[0] - x]


def by_control(pose: Any, v: Any, turn: Any) -> list[Any]:
    """Rows of V for x', y'."""
    a = turn / 2
    c, s, half = cos(pose[2] + a), sin(pose[2] + a), v / 2
    return [
        [ratio(a) * c, half * (slope(a) * c - ratio(a) * s)],
        [ratio(a) * s, half * (slope(a) * s + ratio(a) * c)],
    ]


def noise(v: Any, turn: Any, alphas: Any) -> list[Any]:
    """Diagonal of M."""
    return [alphas[0] * v**2 + alphas[1] * turn**2, alphas[2] * v**2 + alphas[3] * turn**2]


def control(start: Any, end: Any) -> list[Any]:
    """V and the turn between two odometry poses."""
    turn = wrap(end[2] - start[2])
    middle = start[2] + turn / 2
    chord = (end[0] - start[0]) * cos(middle) + (end[1] - start[1]) * sin(middle)
    return [chord / ratio(turn / 2), turn]


def absolute(scale: float, reason: str, *, turn: bool = False) -> dict[str, Any]:
    """Tolerance of some roundings at a scale."""
    word = {"turn": True} if turn else {}
    return {
        "float64": {"abs": 8e-16 * scale, "reason": reason, **word},
        "float32": {"abs": 2e-7 * scale, "reason": f"{reason}; rounded to float32", **word},
    }


def relative(rel: float, reason: str) -> dict[str, Any]:
    """Relative tolerance; in float32 that of rounding the result."""
    return {
        "float64": {"rel": rel, "abs": 5e-324, "reason": reason},
        "float32": {"rel": 1.3e-7 + rel, "reason": f"{reason}; rounded to float32"},
    }


ORIGIN, FIELD = [0.0, 0.0, 0.0], [0.3, -1.7, 2.9]
CONTROLS = {
    "standing still": (FIELD, 0.0, 0.0),
    "straight on": (FIELD, 0.2, 0.0),
    "backwards": (FIELD, -0.2, 0.0),
    "a turn of the smallest number": (ORIGIN, 0.2, 5e-324),
    "a turn of 1e-300": (ORIGIN, 0.2, 1e-300),
    "a turn of 1e-12": (ORIGIN, 0.2, 1e-12),
    "a turn of 1e-9 backwards": (ORIGIN, -0.2, -1e-9),
    "a turn of 1e-5": (FIELD, 0.2, 1e-5),
    "a turn on the spot": (FIELD, 0.0, 1.0),
    "across the seam of headings": ([0.0, 0.0, 3.1], 0.2, 0.1),
    "half a turn": (FIELD, 0.2, math.pi),
    "a whole turn comes back": (ORIGIN, 0.2, 2 * math.pi),
    "just below the series' end": (FIELD, 3.0, 1.9999999),
    "just above the series' end": (FIELD, 3.0, 2.0000001),
    "a thousand turns": (FIELD, 10.0, 2000 * math.pi + 0.5),
    "a step of 1e-12 m": (ORIGIN, 1e-12, 0.3),
    "a step of 1e12 m": (ORIGIN, 1e12, 0.3),
}
SLOPES = [
    *(0.0, 5e-324, 1e-300, 1e-12, 1e-9, -1e-9, 1e-4, 0.04999, 0.05001, 0.999999, 1.000001),
    *(1.5, math.pi, 10.0, -300.0),
]
ODOMETRY = {
    "standing still": (FIELD, FIELD),
    "straight on": ([0.0, 0.0, 0.5], [0.2 * math.cos(0.5), 0.2 * math.sin(0.5), 0.5]),
    "backwards": ([0.0, 0.0, 0.5], [-0.2 * math.cos(0.5), -0.2 * math.sin(0.5), 0.5]),
    "a turn on the spot": (ORIGIN, [0.0, 0.0, 1.0]),
    "a tiny turn": (ORIGIN, [0.2, 0.0, 1e-12]),
    "across the seam": ([0.0, 0.0, 3.1], [-0.2, 0.0, -3.1]),
    "nearly half a turn": (ORIGIN, [0.0, 0.1, 3.14159]),
    "slip to the side": (ORIGIN, [0.2, 0.05, 0.0]),
}


def main() -> None:
    """Write the cases of the group."""
    _write_moves()
    rows = [
        case(f"a = {a:g}", {"a": a}, exact=slope, tolerance=relative(4e-15, "a dozen roundings"))
        for a in SLOPES
    ]
    write("motion", "chord_over_arc_slope", rows)
    rows = [
        case(
            name,
            {"start": a, "end": b},
            exact=control,
            tolerance=absolute(4.0, "some roundings of poses up to 3", turn=True),
        )
        for name, (a, b) in ODOMETRY.items()
    ]
    rows.append(
        refusal(
            "a pose that is not a number",
            {"start": ORIGIN, "end": [0.0, math.nan, 0.0]},
            expect="error",
            which="an odometry pose",
        )
    )
    write("motion", "control_from_odometry", rows)
    _write_noise()


def _write_moves() -> None:
    files: dict[str, list[Any]] = {"position": [], "heading": [], "by_pose": [], "by_control": []}
    for name, (pose, v, turn) in CONTROLS.items():
        inputs = {"pose": pose, "v": v, "turn": turn}
        # A heading of many turns is rounded at its own size.
        far = 1.0 + abs(turn) / 8.0
        reach = max(abs(v), *map(abs, pose[:2]))
        moves = absolute(reach * far, "some roundings of the larger of pose and step")
        files["position"].append(case(name, inputs, exact=position, tolerance=moves))
        files["by_pose"].append(
            case(name, inputs, exact=by_pose, tolerance=absolute(abs(v) * far, "of the step"))
        )
        slopes = absolute((1.0 + abs(v)) * far, "of one and the step")
        files["by_control"].append(case(name, inputs, exact=by_control, tolerance=slopes))
        angle = absolute(4.0 * far, "of pi and the turn", turn=True)
        files["heading"].append(case(name, inputs, exact=heading, tolerance=angle))
    for name, v, turn in (("infinite", math.inf, 0.0), ("not a number", 0.0, math.nan)):
        files["position"].append(
            refusal(
                name,
                {"pose": ORIGIN, "v": v, "turn": turn},
                expect="error",
                which="a control must be finite",
            )
        )
    for formula, rows in files.items():
        write("motion", formula, rows)


def _write_noise() -> None:
    alphas = [0.01, 0.001, 0.0005, 0.0064]
    steps = {"at rest": (0.0, 0.0), "a step": (0.2, 0.1), "backwards": (-0.2, -3.0)}
    rows = [
        case(
            name,
            {"v": v, "turn": turn, "alphas": alphas},
            exact=noise,
            tolerance=relative(5e-16, "four roundings"),
        )
        for name, (v, turn) in steps.items()
    ]
    for name, wrong in (("negative", -1e-9), ("not a number", math.nan)):
        rows.append(
            refusal(
                f"an alpha is {name}",
                {"v": 0.2, "turn": 0.0, "alphas": [0.01, wrong, 0.0, 0.0]},
                expect="error",
                which="the alphas are variances",
            )
        )
    write("motion", "noise", rows)


if __name__ == "__main__":
    main()
