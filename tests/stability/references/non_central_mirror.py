"""Image radii of mirrors without a viewpoint: vertex, apex, 90 degrees, rim, grazing incidence."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from mpmath import asin, atan, findroot, mp, mpf, pi, sin, tan

from stability.references.mirror_exact import AFTER_1, BEFORE_1
from stability.references.writing import case, refusal, write

GROUP = "non_central"
# Next to grazing incidence theta grows with the root of the distance from the outline.
TOLERANCE = {
    "float64": {"rel": 2e-14, "abs": 1e-322, "reason": "some dozen roundings, none amplified"},
    "float32": {"rel": 4e-6, "abs": 1.5e-45, "reason": "some dozen of 6e-8, inputs included"},
}
APEX = {
    "float64": {"abs": 1e-15, "reason": "an angle of pi is known to 4e-16"},
    "float32": {"abs": 3e-7, "reason": "an angle of pi is known to 2e-7"},
}
RIM = math.radians(120.0)

Parameters = dict[str, float | list[float]]


def _solve(function: Callable[[Any], Any], value: Any, start: float) -> Any:
    """Argument of an increasing function, by the secant method from a float nearby."""
    if value == 0:
        return mpf(0)
    with mp.workdps(80):
        return findroot(lambda x: function(x) - value, (mpf(start), mpf(start) * (1 + mpf("1e-6"))))


def spherical(t: Any, radius_m: Any, centre_distance_m: Any, rim_rad: Any) -> Any:
    """tan(psi) with theta = 2 asin(d sin(psi) / R) - psi."""
    ratio, theta = centre_distance_m / radius_m, 2 * atan(t)
    # i = (theta + psi) / 2 is the unknown: sin(2 i - theta) = sin(i) / ratio, steep nowhere.
    incidence = _solve(
        lambda i: 2 * i - asin(sin(i) / ratio),
        theta,
        float(theta) * float(ratio) / (2 * float(ratio) - 1),
    )
    return tan(2 * incidence - theta)


def conical(t: Any, half_angle_rad: Any, apex_distance_m: Any, rim_rad: Any) -> Any:
    """tan(theta - (pi - 2 alpha))."""
    return tan(2 * atan(t) - (pi - 2 * half_angle_rad))


def equiangular(t: Any, gain: Any, vertex_distance_m: Any, rim_rad: Any) -> Any:
    """tan(theta / g)."""
    return tan(2 * atan(t) / gain)


def profile(
    t: Any, radii_m: list[Any], sags_m: list[Any], vertex_distance_m: Any, rim_rad: Any
) -> Any:
    """Of a parabola of the sag a r^2, which the spline is exactly."""
    a = sags_m[-1] / radii_m[-1] ** 2

    def theta_of(r: Any) -> Any:
        return atan(r / (vertex_distance_m + a * r**2)) + 2 * atan(2 * a * r)

    theta = 2 * atan(t)
    start = float(tan(theta / 2)) / (2 * float(a)) if theta != 0 else 0.0
    r = _solve(theta_of, theta, start)
    return r / (vertex_distance_m + a * r**2)


def radial_table(
    t: Any, angles_deg: list[Any], image_radii: list[Any], vertex_distance_m: Any, rim_rad: Any
) -> Any:
    """Of a x + b x^3, x in degrees, which the spline is exactly."""
    (low, high), (low_radius, high_radius) = angles_deg[-2:], image_radii[-2:]
    b = (high_radius / high - low_radius / low) / (high**2 - low**2)
    a = high_radius / high - b * high**2
    x = 2 * atan(t) * 180 / pi
    return a * x + b * x**3


BALL: Parameters = {"radius_m": 0.03125, "centre_distance_m": 0.1875, "rim_rad": RIM}
CONE: Parameters = {"half_angle_rad": 1.0, "apex_distance_m": 0.25, "rim_rad": 1.75}
FLAT: Parameters = {"gain": 8.0, "vertex_distance_m": 0.125, "rim_rad": RIM}
# 8 r^2 at sixteenths: exact in float32 as well.
KNOTS = [0.0, 0.0625, 0.125, 0.25]
BOWL: Parameters = {
    "radii_m": KNOTS,
    "sags_m": [8.0 * r * r for r in KNOTS],
    "vertex_distance_m": 0.5,
    "rim_rad": RIM,
}
# 64 x - x^3 of 32 degrees, over 1024: exact in float32 as well.
ROWS = [0.0, 1.0, 2.0, 3.0, 4.0]
TABLE: Parameters = {
    "angles_deg": [32.0 * x for x in ROWS],
    "image_radii": [(64.0 * x - x**3) / 1024.0 for x in ROWS],
    "vertex_distance_m": 0.5,
    "rim_rad": RIM,
}
FORMULAS: dict[str, tuple[Parameters, Callable[..., Any]]] = {
    "spherical": (BALL, spherical),
    "equiangular": (FLAT, equiangular),
    "profile": (BOWL, profile),
    "radial_table": (TABLE, radial_table),
}
PLACES = {
    "at the vertex": 0.0,
    "1e-12 beside the vertex": 1e-12,
    "1e-8 beside the vertex": 1e-8,
    "half way to 90 degrees": 0.5,
    "an ulp below 90 degrees": BEFORE_1,
    "90 degrees": 1.0,
    "an ulp above 90 degrees": AFTER_1,
    "119 degrees": math.tan(math.radians(59.5)),
}


def rows(name: str) -> list[dict[str, Any]]:
    """Cases of a mirror with a vertex."""
    parameters, exact = FORMULAS[name]
    values = [
        case(place, {**parameters, "t": t}, exact=exact, tolerance=TOLERANCE)
        for place, t in PLACES.items()
    ]
    return [*values, *_refusals(parameters, beyond=1.8)]


def grazing_rows() -> list[dict[str, Any]]:
    """Cases of a ball seen to its outline."""
    limit = math.pi - math.asin(BALL["radius_m"] / BALL["centre_distance_m"])  # type: ignore[operator]
    ball = {**BALL, "rim_rad": limit - 1e-4}
    return [
        case(
            f"grazing, {beside:g} rad before the outline",
            {**ball, "t": math.tan(0.5 * (limit - beside))},
            exact=spherical,
            tolerance=TOLERANCE,
        )
        for beside in (0.1, 1e-3)
    ]


def cone_rows() -> list[dict[str, Any]]:
    """Cases of a cone, from the apex on."""
    apex_t = math.tan(0.5 * (math.pi - 2.0))
    values = [
        case(place, {**CONE, "t": t}, exact=conical, tolerance=APEX)
        for place, t in {
            "a microradian beside the apex": math.tan(0.5 * (math.pi - 2.0 + 1e-6)),
            "a degree beside the apex": math.tan(0.5 * (math.pi - 2.0 + 0.0175)),
            "90 degrees": 1.0,
            "next to the rim": math.tan(0.5 * 1.7499),
        }.items()
    ]
    inside = {**CONE, "t": 0.9 * apex_t}
    nearer = refusal("nearer to the axis than the apex shows", inside, expect="error", which="rim")
    return [*values, nearer, *_refusals(CONE, beyond=1.3)]


def _refusals(parameters: Parameters, *, beyond: float) -> list[dict[str, Any]]:
    values = {"below zero": -1e-9, "no number": math.nan, "beyond the rim": beyond}
    return [
        refusal(f"t {name}", {**parameters, "t": t}, expect="error", which="rim")
        for name, t in values.items()
    ]


if __name__ == "__main__":
    write(GROUP, "spherical", [*rows("spherical"), *grazing_rows()])
    write(GROUP, "conical", cone_rows())
    write(GROUP, "equiangular", rows("equiangular"))
    write(GROUP, "profile", rows("profile"))
    write(GROUP, "radial_table", rows("radial_table"))
