"""Image radii of wide-angle lenses and their inverses: axis, 90 degrees, limit, fold, antipode."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from mpmath import atan, atan2, cos, findroot, mp, mpf, sin, sqrt, tan

from catoptra_protocol.optics.lenses import LENSES
from stability.references.mirror_exact import AFTER_1, BEFORE_1
from stability.references.writing import case, float64_case, refusal, write

GROUP = "wide_angle"
TOLERANCE = {
    "float64": {"rel": 2e-14, "abs": 1e-322, "reason": "some dozen roundings, none amplified"},
    "float32": {"rel": 4e-6, "abs": 1.5e-45, "reason": "some dozen of 6e-8, inputs included"},
}
# t of a radius amplifies a rounding by (m / t) dt/dm, some tens next to a limit.
INVERSE = {
    "float64": {"rel": 2e-12, "abs": 1e-322, "reason": "radii next to the limit hardly grow"},
    "float32": {"rel": 4e-4, "abs": 1.5e-45, "reason": "radii next to the limit hardly grow"},
}

Parameters = dict[str, float | list[float]]
Radius = Callable[..., Any]


def _polynomial(theta: Any, terms: list[Any]) -> Any:
    return sum(c * theta ** (power + 1) for power, c in enumerate(terms))


def _kannala_brandt(theta: Any, k1: Any, k2: Any, k3: Any, k4: Any) -> Any:
    return _polynomial(theta, [mpf(1), 0, k1, 0, k2, 0, k3, 0, k4])


def _unified(theta: Any, xi: Any, k1: Any, k2: Any) -> Any:
    m = sin(theta) / (xi + cos(theta))
    return m * (1 + k1 * m**2 + k2 * m**4)


def _enhanced_unified(theta: Any, alpha: Any, beta: Any) -> Any:
    d = sqrt(beta * sin(theta) ** 2 + cos(theta) ** 2)
    return sin(theta) / (alpha * d + (1 - alpha) * cos(theta))


def _double_sphere(theta: Any, xi: Any, alpha: Any) -> Any:
    d = sqrt(sin(theta) ** 2 + (xi + cos(theta)) ** 2)
    return sin(theta) / (alpha * d + (1 - alpha) * (xi + cos(theta)))


def _ocam_angle(rho: Any, polynomial: list[Any]) -> Any:
    return atan2(rho, sum(a * rho**power for power, a in enumerate(polynomial)))


def _ocam_start(theta: Any, polynomial: list[Any]) -> float:
    """Radius nearby: next to the fold no other start leads to the root before it."""
    lens = LENSES["ocam"](tuple(map(float, polynomial)))  # type: ignore[call-arg] # of OCam
    return float(lens.radius_ratio_from_t(np.array(min(float(tan(theta / 2)), lens.t_limit))))


def _solve(function: Callable[[Any], Any], value: Any, start: float) -> Any:
    """Argument of an increasing function, by the secant method from a float nearby."""
    if value == 0:
        return mpf(0)
    # Derivatives need twice the digits that they have.
    with mp.workdps(min(max(80, mp.dps), 160)):
        return findroot(lambda x: function(x) - value, (mpf(start), mpf(start) * (1 - mpf("1e-6"))))


KB = {"k1": 0.00348239, "k2": 0.00071503, "k3": -0.00205324, "k4": 0.00020294}
BACK = {"xi": 1.19807, "k1": -0.25709, "k2": 0.01283}
FORMULAS: dict[str, tuple[Parameters, Radius]] = {
    "equidistant": ({}, lambda theta: theta),
    "equisolid": ({}, lambda theta: 2 * sin(theta / 2)),
    "stereographic": ({}, lambda theta: 2 * tan(theta / 2)),
    "orthographic": ({}, lambda theta: sin(theta)),
    "kannala_brandt": (dict(KB), _kannala_brandt),
    "unified": (dict(BACK), _unified),
    "enhanced_unified": ({"alpha": 0.6, "beta": 1.1}, _enhanced_unified),
    "double_sphere": ({"xi": -0.17213, "alpha": 0.59312}, _double_sphere),
    "woodscape": (
        {"k1": 339.749, "k2": -31.988, "k3": 48.275, "k4": -7.201},
        lambda theta, k1, k2, k3, k4: _polynomial(theta, [k1, k2, k3, k4]),
    ),
    "f_theta": (
        {"k1": 0.003, "k2": 1e-7, "k3": -1e-10, "k4": 0.0},
        lambda theta, k1, k2, k3, k4: _solve(
            lambda r: _polynomial(r, [k1, k2, k3, k4]), theta, float(theta) / 0.003
        ),
    ),
    "ocam": (
        {"polynomial": [209.2008, 0.0, -0.00213742, 4.22036e-6, -1.771461e-8]},
        lambda theta, polynomial: _solve(
            lambda r: _ocam_angle(r, polynomial), theta, _ocam_start(theta, polynomial)
        ),
    ),
    "radial_table": (
        # A straight line: its spline is the line itself.
        {"angles_deg": [0.0, 40.0, 80.0, 160.0], "radii": [0.0, 100.0, 200.0, 400.0]},
        lambda theta, angles_deg, radii: theta * 180 / mp.pi * radii[1] / angles_deg[1],
    ),
}

PLACES = {
    "on the axis": 0.0,
    "1e-300 beside the axis": 1e-300,
    "1e-8 beside the axis": 1e-8,
    "half way to 90 degrees": 0.5,
    "an ulp below 90 degrees": BEFORE_1,
    "90 degrees": 1.0,
}
BEYOND_90 = {
    "an ulp above 90 degrees": AFTER_1,
    "117 degrees, a degree before the fold": math.tan(math.radians(58.5)),
}
NEXT_TO_ANTIPODE = {"a microradian before the antipode": math.tan(0.5 * (math.pi - 1e-6))}
REACHES_ANTIPODE = ("equidistant", "equisolid", "kannala_brandt", "woodscape")


def places(lens: str) -> dict[str, float]:
    """Values of t at which a lens is checked."""
    chosen = dict(PLACES)
    if lens != "orthographic":
        chosen |= BEYOND_90
    if lens in REACHES_ANTIPODE:
        chosen |= NEXT_TO_ANTIPODE
    return chosen


def radius_rows(lens: str) -> list[dict[str, Any]]:
    """Cases of radius_ratio_from_t."""
    parameters, formula = FORMULAS[lens]

    def exact(t: Any, **given: Any) -> Any:
        return formula(2 * atan(t), **given)

    return [
        *(
            case(f"radius {name}", {**parameters, "t": t}, exact=exact, tolerance=TOLERANCE)
            for name, t in places(lens).items()
        ),
        *_refusals(lens, parameters, "t"),
    ]


def inverse_rows(lens: str) -> list[dict[str, Any]]:
    """Cases of t_from_radius_ratio, at the doubles next to radii of known angles."""
    parameters, formula = FORMULAS[lens]

    def exact(ratio: Any, **given: Any) -> Any:
        on_axis = formula(mpf("1e-60"), **given) / mpf("1e-60")
        start = starts.get(float(ratio), float(ratio / on_axis))
        return tan(_solve(lambda theta: formula(theta, **given), ratio, start) / 2)

    starts: dict[float, float] = {}
    rows = []
    for name, t in places(lens).items():
        # The antipode's circle and the fold's have radii that no double resolves.
        if t > 10.0 or "fold" in name or (lens == "orthographic" and t > 0.6):
            continue
        with mp.workdps(60):
            ratio = float(formula(2 * atan(mpf(t)), **_exact(parameters)))
        starts[ratio] = 2.0 * math.atan(t)
        inputs = {**parameters, "ratio": ratio}
        rows.append(case(f"angle {name}", inputs, exact=exact, tolerance=INVERSE))
    return [*rows, *_refusals(lens, parameters, "ratio")]


# By which an argument is changed to find what the formula amplifies it by.
_PART = mpf("1e-30")
_NANODEGREE_RAD = math.radians(1e-9)
# Lenses whose formula cancels next to 180 degrees, and radii beyond the square root of 1.8e308.
NEXT_TO_180: list[tuple[str, Parameters]] = [
    ("enhanced_unified", {"alpha": 0.5, "beta": 1.1}),
    ("enhanced_unified", {"alpha": 0.5 - 1e-9, "beta": 0.9}),
    ("enhanced_unified", {"alpha": 0.5 + 1e-9, "beta": 1.0}),
    ("double_sphere", {"xi": -0.2, "alpha": 0.5}),
    ("double_sphere", {"xi": 0.3, "alpha": 0.5 - 1e-9}),
    ("double_sphere", {"xi": 0.9, "alpha": 0.5 + 1e-9}),
    ("double_sphere", {"xi": 1.0, "alpha": 0.6}),
    ("unified", {"xi": 1.0, "k1": 0.0, "k2": 0.0}),
    ("unified", {"xi": 1.0, "k1": 0.01, "k2": 0.0}),
    ("unified", {"xi": 1.0 - 1e-9, "k1": 0.0, "k2": 0.0}),
]
VAST: list[tuple[str, Parameters]] = [
    ("unified", {"xi": 0.9, "k1": 0.0, "k2": 0.0}),
    ("unified", {"xi": 0.5, "k1": 0.01, "k2": 0.0}),
    ("unified", {"xi": 0.0, "k1": 0.0, "k2": 0.001}),
    ("enhanced_unified", {"alpha": 0.3, "beta": 1.1}),
    ("enhanced_unified", {"alpha": 0.0, "beta": 2.0}),
    ("double_sphere", {"xi": -0.2, "alpha": 0.3}),
    ("double_sphere", {"xi": 0.2, "alpha": 0.49}),
]


def end_rows(lens: str) -> list[dict[str, Any]]:
    """Cases next to the ends of the angle and of float64: 1e-12 times the condition."""
    usual = FORMULAS[lens][0]
    rows = [*_rows_of_end(lens, usual, "", _NANODEGREE_RAD)]
    for number, (name, parameters) in enumerate(NEXT_TO_180):
        if name == lens:
            for off in (1e-3, 1e-6, 1e-9):
                where = f" of lens {number} {off:g} deg off"
                rows += _rows_of_end(lens, parameters, where, math.radians(off))
    for number, (name, parameters) in enumerate(VAST):
        if name == lens:
            rows += [
                _vast_row(lens, parameters, number, ratio) for ratio in (1.4e154, 2e154, 1e300)
            ]
    if lens == "equisolid":
        row = {"t": 1e300}
        exact = lambda t: FORMULAS[lens][1](2 * atan(t))  # noqa: E731 # of one line
        rows.append(float64_case("radius t 1e300", row, exact=exact, tolerance=TOLERANCE))
    return rows


def _rows_of_end(
    lens: str, parameters: Parameters, where: str, off_rad: float
) -> list[dict[str, Any]]:
    """The radius of an angle next to the lens's last one, and the angle of that radius."""
    formula = FORMULAS[lens][1]
    made = {k: tuple(v) if isinstance(v, list) else v for k, v in parameters.items()}
    with mp.workdps(60):
        theta = min(2 * atan(mpf(LENSES[lens](**made).t_limit)), mp.pi) - mpf(off_rad)
        t = float(tan(theta / 2))

    def radius(t: Any, **given: Any) -> Any:
        return formula(2 * atan(t), **given)

    with mp.workdps(60):
        exact = _exact(parameters)
        ratio, size = float(radius(mpf(t), **exact)), abs(radius(mpf(t), **exact))
        by_t = abs(radius(mpf(t) * (1 + _PART), **exact) - size) / _PART / size
    rows = [
        float64_case(
            f"radius at the end{where}",
            {**parameters, "t": t},
            exact=radius,
            tolerance=_conditioned(max(1.0, float(by_t))),
        )
    ]
    # Radii of a fold are no angle's to a digit.
    if by_t > 1e-9 and not where.endswith("e-09 deg off"):
        rows.append(_angle_row(lens, parameters, f"angle at the end{where}", ratio, t, by_t))
    return rows


def _angle_row(
    lens: str, parameters: Parameters, name: str, ratio: float, start: float, by_t: Any
) -> dict[str, Any]:
    formula = FORMULAS[lens][1]

    def angle(ratio: Any, **given: Any) -> Any:
        return _solve(lambda t: formula(2 * atan(t), **given), ratio, start)

    tolerance = _conditioned(max(1.0, float(1 / by_t)))
    return float64_case(name, {**parameters, "ratio": ratio}, exact=angle, tolerance=tolerance)


def _vast_row(lens: str, parameters: Parameters, number: int, ratio: float) -> dict[str, Any]:
    """The angle of a radius without a square: the limit, which the formula's denominator ends at.

    What the angle is below it has 150 digits less than float64 tells apart.
    """
    formula = FORMULAS[lens][1]

    def angle(ratio: Any, **given: Any) -> Any:
        # The distortion has no part in the angle at which the undistorted radius ends.
        given |= {key: mpf(0) for key in ("k1", "k2") if key in given}

        def inverse(t: Any) -> Any:
            try:
                return 1 / formula(2 * atan(t), **given)
            except ZeroDivisionError:
                return mpf(0)

        with mp.workdps(80):
            return findroot(inverse, start)

    made = {k: tuple(v) if isinstance(v, list) else v for k, v in parameters.items()}
    limit = LENSES[lens](**made).t_limit
    start = (mpf(limit) * (1 - mpf("1e-9")), mpf(limit) * (1 - mpf("1e-6")))
    return float64_case(
        f"angle {ratio:g} of lens {number}",
        {**parameters, "ratio": ratio},
        exact=angle,
        tolerance=_conditioned(1.0),
    )


def _conditioned(condition: float) -> dict[str, Any]:
    reason = f"1e-12 times a condition of {condition:.1e}"
    return {"float64": {"rel": 1e-12 * condition, "reason": reason}}


def _exact(parameters: Mapping[str, Any]) -> dict[str, Any]:
    return {
        key: [mpf(x) for x in value] if isinstance(value, list) else mpf(value)
        for key, value in parameters.items()
    }


def _refusals(lens: str, parameters: Parameters, of: str) -> list[dict[str, Any]]:
    values = {"below zero": -1e-9, "no number": math.nan}
    if of == "t" and lens in ("orthographic", "unified", "enhanced_unified", "double_sphere"):
        values["beyond the limit"] = 100.0
    if of == "t" and lens == "unified":
        values["beyond the fold, where the formula goes on"] = math.tan(math.radians(59.5))
    which = "0" if of == "ratio" else "t = tan(theta / 2)"
    return [
        refusal(f"{of} {name}", {**parameters, of: value}, expect="error", which=which)
        for name, value in values.items()
    ]


if __name__ == "__main__":
    for one in FORMULAS:
        write(GROUP, one, [*radius_rows(one), *inverse_rows(one), *end_rows(one)])
