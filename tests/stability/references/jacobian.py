"""Derivatives of pixels by direction, point and parameters, and of directions by pixels.

The published formulas, differentiated by mpmath with 40 digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from mpmath import atan2, cos, diff, matrix, mp, mpf, sin, sqrt

from catoptra_protocol.optics.lenses import LENSES
from stability.references.wide_angle_lens import FORMULAS
from stability.references.writing import float64_case, refusal, write

GROUP = "jacobian"
IMAGE = ["centre_u_px", "centre_v_px", "scale_px", "image_up_azimuth_rad"]
PLANE = ["stretch_0", "stretch_1", "stretch_2", "stretch_3"]
# Of a mirrored picture, turned, stretched and, of Mei's lens, decentred.
NUMBERS = [320.5, 240.25, 100.0, 0.3, 1.0, 0.01, 0.02, 1.1]
HYPERBOLA = {"k": 11.546}


def _hyperbola(theta: Any, k: Any) -> Any:
    xi = sqrt(k * (k - 2)) / (k - 1)
    return sin(theta) / (1 + cos(theta) / xi)


MODELS: dict[str, tuple[dict[str, Any], Callable[..., Any]]] = {
    **FORMULAS,
    "hyperbolic": (HYPERBOLA, _hyperbola),
}
# A table's spline is a line here: other radii would bend it.
FIXED = ("angles_deg", "radii")


def names(model: str) -> list[str]:
    """Parameters of a camera of a model that are differentiated."""
    own: list[str] = []
    for name, value in MODELS[model][0].items():
        if name not in FIXED:
            own += [f"{name}_{i}" for i in range(len(value))] if isinstance(value, list) else [name]
    return [*IMAGE, *PLANE, *(["p1", "p2"] if model == "unified" else []), *own]


def values(model: str) -> list[float]:
    """Their values."""
    own: list[float] = []
    for name, value in MODELS[model][0].items():
        if name not in FIXED:
            own += value if isinstance(value, list) else [value]
    return [*NUMBERS, *([1e-3, -2e-3] if model == "unified" else []), *own]


def pixel(model: str, numbers: list[Any], direction: list[Any]) -> list[Any]:
    """[u, v] of a direction."""
    given = dict(zip(names(model), numbers, strict=True))
    shape: dict[str, Any] = {}
    for name, value in MODELS[model][0].items():
        if isinstance(value, list):
            entries = [given.get(f"{name}_{i}", mpf(each)) for i, each in enumerate(value)]
            shape[name] = entries
        else:
            shape[name] = given[name]
    x, y, z = direction
    rho = sqrt(x * x + y * y)
    theta, up = atan2(rho, z), given["image_up_azimuth_rad"]
    right, down = (cos(up) * y - sin(up) * x) / rho, -(cos(up) * x + sin(up) * y) / rho
    if model == "unified":
        m = sin(theta) / (shape["xi"] + cos(theta))
        px, py, gain = m * right, m * down, 1 + shape["k1"] * m**2 + shape["k2"] * m**4
        p1, p2 = given["p1"], given["p2"]
        ox = gain * px + 2 * p1 * px * py + p2 * (3 * px * px + py * py)
        oy = gain * py + p1 * (px * px + 3 * py * py) + 2 * p2 * px * py
    else:
        radius = MODELS[model][1](theta, **shape)
        ox, oy = radius * right, radius * down
    a, b, c, d = (given[name] for name in PLANE)
    scale = given["scale_px"]
    return [
        given["centre_u_px"] - scale * (a * ox + b * oy),
        given["centre_v_px"] + scale * (c * ox + d * oy),
    ]


def _by_direction(model: str, direction: list[Any]) -> list[list[Any]]:
    with mp.workdps(40):
        numbers = [mpf(each) for each in values(model)]

        def entry(row: int, column: int) -> Any:
            def value(x: Any) -> Any:
                moved = [*direction[:column], x, *direction[column + 1 :]]
                return pixel(model, numbers, moved)[row]

            return diff(value, direction[column])

        return [[entry(row, column) for column in range(3)] for row in range(2)]


def _by_parameter(model: str, direction: list[Any], parameter: str) -> list[Any]:
    place = names(model).index(parameter)
    with mp.workdps(40):
        numbers = [mpf(each) for each in values(model)]

        def value(row: int) -> Callable[[Any], Any]:
            return lambda x: pixel(model, [*numbers[:place], x, *numbers[place + 1 :]], direction)[
                row
            ]

        return [diff(value(row), numbers[place]) for row in range(2)]


def _by_pixel(model: str, direction: list[Any]) -> list[list[Any]]:
    """Directions by pixels: the inverse of the derivative along the sphere's two axes."""
    with mp.workdps(40):
        x, y, z = direction
        rho = sqrt(x * x + y * y)
        along = [z * x / rho, z * y / rho, -rho]
        across = [-y / rho, x / rho, mpf(0)]
        axes = matrix([[along[i], across[i]] for i in range(3)])
        found = axes * (matrix(_by_direction(model, direction)) * axes) ** -1
        return [[found[row, column] for column in range(2)] for row in range(3)]


def places(model: str) -> dict[str, tuple[float, float]]:
    """Angles from the axis (rad), and of the rim, at which a model is checked."""
    if model == "hyperbolic":
        limit = 2.0 * math.atan(4.5)
    else:
        made = {k: tuple(v) if isinstance(v, list) else v for k, v in MODELS[model][0].items()}
        limit = 2.0 * math.atan(LENSES[model](**made).t_limit)
    if model == "unified":
        # With tangential distortion the image turns back at 117.484 degrees.
        limit = math.radians(117.484)
    rim, end = 0.999 * limit, limit * (1.0 - 1e-6)
    return {
        "half way": (0.5 * limit, rim),
        "1e-8 beside the axis": (1e-8, rim),
        "next to the end": (end * (1.0 - 1e-5), end),
        "at the end": (limit * (1.0 - 1e-11), limit * (1.0 - 1e-12)),
    }


def rows() -> dict[str, list[dict[str, Any]]]:
    """Cases by formula."""
    found: dict[str, list[dict[str, Any]]] = {
        "by_direction": [],
        "by_parameter": [],
        "by_pixel": [],
    }
    for model in MODELS:
        for place, (theta, rim) in places(model).items():
            direction = [math.sin(theta) * 0.6, math.sin(theta) * -0.8, math.cos(theta)]
            inputs = {"model": model, "direction": direction, "rim_rad": rim}
            name = f"{model} {place}"
            found["by_direction"].append(jacobian_case(name, inputs, _by_direction))
            # At a fold or limit a parameter may move nothing, and rays have no derivative.
            if place == "at the end":
                continue
            if place != "next to the end":
                found["by_pixel"].append(jacobian_case(name, inputs, _by_pixel))
            for parameter in names(model):
                given = {**inputs, "parameter": parameter}
                row = jacobian_case(f"{name} {parameter}", given, _by_parameter)
                found["by_parameter"].append(row)
        beyond = {"model": model, "direction": [0.0, 0.0, -1.0], "rim_rad": 0.5}
        found["by_direction"].append(
            refusal(f"{model} beyond the rim", beyond, expect="invalid", which="")
        )
    return found


def jacobian_case(
    name: str, inputs: dict[str, Any], exact: Callable[..., Any], split: int = 0
) -> dict[str, Any]:
    """Case of derivatives, in one unit or, from the row `split` on, in another."""

    def value(rim_rad: Any = None, **given: Any) -> Any:
        return exact(**given)

    row = float64_case(name, inputs, exact=value, tolerance={})
    blocks = filter(None, (row["reference"][:split], row["reference"][split:]))
    largest = min(max(map(abs, map(float, np.ravel(block)))) for block in blocks)
    bound = {"abs": max(1e-10 * largest, 1e-40), "reason": "1e-10 of the largest derivative"}
    row["tolerance"]["float64"] = {"rel": 1e-10, **bound} if split else bound
    return row


if __name__ == "__main__":
    for formula, cases in rows().items():
        write(GROUP, formula, cases)
