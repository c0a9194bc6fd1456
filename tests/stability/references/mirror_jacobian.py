"""Derivatives of pixels by point, direction and pose, and of rays by pixel, without a viewpoint.

By the law of reflection on the published surfaces: the one unknown, the surface's parameter, is
solved and differentiated by mpmath with 40 digits.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from mpmath import (
    atan,
    atan2,
    cos,
    diff,
    exp,
    findroot,
    hypot,
    matrix,
    mp,
    mpf,
    pi,
    quad,
    sin,
    tan,
)

from catoptra_protocol.optics.mirrors import MIRRORS as MODELS
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror
from stability.references.jacobian import NUMBERS, jacobian_case, pixel
from stability.references.non_central_mirror import BALL, BOWL, CONE, FLAT, TABLE, Parameters
from stability.references.writing import write

GROUP = "jacobian"
# Nearer to the ball's outline than half a degree, roundings of the pixel itself are amplified.
OUTLINE_RAD = math.pi - math.asin(1.0 / 6.0)
MIRRORS: dict[str, Parameters] = {
    "spherical": BALL,
    "spherical to its outline": {**BALL, "rim_rad": OUTLINE_RAD - 0.01},
    "conical": CONE,
    "equiangular": FLAT,
    "profile": BOWL,
    "radial_table": TABLE,
}
DISTANCES_M = {"1 mm away": 1e-3, "3 m away": 3.0, "at infinity": math.inf}
UP = (0.6, -0.8)
# Parameters of the surfaces beyond their rims.
LAST = {
    "spherical": 1.3,
    "spherical to its outline": math.acos(1.0 / 6.0) - 1e-7,
    "conical": 0.9,
    "equiangular": 0.3,
    "profile": 0.25,
    "radial_table": 2.2,
}

# r, depth from the pinhole, and their derivatives by the surface's parameter.
Profile = tuple[Any, Any, Any, Any]


def _ball(a: Any, radius_m: Any, centre_distance_m: Any) -> Profile:
    across, along = radius_m * sin(a), radius_m * cos(a)
    return across, centre_distance_m - along, along, across


def _cone(r: Any, half_angle_rad: Any, apex_distance_m: Any) -> Profile:
    slope = 1 / tan(half_angle_rad)
    return r, apex_distance_m + slope * r, mpf(1), slope


def _equiangular(psi: Any, gain: Any, vertex_distance_m: Any) -> Profile:
    half = (1 + gain) / 2
    return _polar(psi, mpf(1), vertex_distance_m * cos(half * psi) ** (-1 / half), tan(half * psi))


def _bowl(r: Any, radii_m: Any, sags_m: Any, vertex_distance_m: Any) -> Profile:
    a = sags_m[-1] / radii_m[-1] ** 2
    return r, vertex_distance_m + a * r * r, mpf(1), 2 * a * r


def _table(theta: Any, angles_deg: Any, image_radii: Any, vertex_distance_m: Any) -> Profile:
    def angle_of(theta: Any) -> tuple[Any, Any, Any]:
        # tan(psi) = (64 x - x^3) / 1024, x the angle over 32 degrees.
        unit = angles_deg[1] * pi / 180
        ratio = (64 * theta / unit - (theta / unit) ** 3) / 1024
        turn = (64 - 3 * (theta / unit) ** 2) / 1024 / unit / (1 + ratio**2)
        return atan(ratio), turn, tan((theta + atan(ratio)) / 2) * turn

    psi, turn, growth = angle_of(theta)
    grown = quad(lambda angle: angle_of(angle)[2], [0, theta], method="gauss-legendre")
    return _polar(psi, turn, vertex_distance_m * exp(grown), growth)


def _polar(psi: Any, turn: Any, distance: Any, growth: Any) -> Profile:
    """Of a camera angle and a distance, whose derivatives are `turn` and distance * growth."""
    s, c = distance * sin(psi), distance * cos(psi)
    return s, c, growth * s + turn * c, growth * c - turn * s


CURVES: dict[str, Callable[..., Profile]] = {
    "spherical": _ball,
    "conical": _cone,
    "equiangular": _equiangular,
    "profile": _bowl,
    "radial_table": _table,
}


def _reflect(mirror: str, parameter: Any) -> tuple[Any, Any, Any, Any]:
    """r, depth, and the scene ray's direction across the axis and towards the pinhole."""
    given = {
        name: [mpf(each) for each in value] if isinstance(value, list) else mpf(value)
        for name, value in MIRRORS[mirror].items()
        if name != "rim_rad"
    }
    r, depth, dr, dd = CURVES[mirror.split()[0]](parameter, **given)
    distance = hypot(r, depth)
    along = 2 * (r * dr + depth * dd) / distance / (dr**2 + dd**2)
    return r, depth, along * dr - r / distance, depth / distance - along * dd


def _solve(mirror: str, miss: Callable[..., Any], start: float) -> tuple[list[Any], list[Any]]:
    """The ray without a miss, by `_reflect`, and its derivatives by the surface's parameter."""

    def missed(parameter: Any) -> Any:
        return miss(*_reflect(mirror, parameter))

    parameter = mpf(start)
    # A start of 16 digits has 64 after two steps of Newton's method; the third is for hard cases.
    for _ in range(3):
        parameter -= missed(parameter) / diff(missed, parameter)
    slopes = [diff(lambda p, i=i: _reflect(mirror, p)[i], parameter) for i in range(4)]
    return list(_reflect(mirror, parameter)), slopes


def _plane() -> tuple[Any, Any]:
    """(2, 1) centre and (2, 2) pixels of an image radius of 1 along x and y of the mirror frame."""
    # An equidistant lens has the angle for its image radius.
    numbers = [mpf(each) for each in NUMBERS]
    across = [pixel("equidistant", numbers, [sin(1) * x, sin(1) * (1 - x), cos(1)]) for x in (1, 0)]
    centre = matrix(numbers[:2])
    return centre, matrix([[column[row] - centre[row] for column in across] for row in range(2)])


def by_point(
    mirror: str, point: list[Any], pinhole_m: Any, is_far: bool, start: float
) -> list[list[Any]]:
    """(4, 3) pixels by a point of the mirror frame, or a direction, and by a turn of the camera."""
    with mp.workdps(40):
        x, y, z = point
        rho, height, near = hypot(x, y), z if is_far else z - pinhole_m, 0 if is_far else 1

        def miss(r: Any, depth: Any, across: Any, up: Any) -> Any:
            return (rho - near * r) * up - (height + near * depth) * across

        (r, depth, across, up), (dr, dd, da, du) = _solve(mirror, miss, start)
        slope = (
            (rho - near * r) * du
            - near * dr * up
            - (height + near * depth) * da
            - near * dd * across
        )
        gain = (dr * depth - r * dd) / depth**2 / -slope
        # The image radius by x, y and height, and the offset that it has in the point's azimuth.
        radius = matrix([[gain * up * x / rho, gain * up * y / rho, -gain * across]])
        turn = matrix([[-y, x, 0]]) / rho**2
        offset = matrix([x, y]) / rho * radius + r / depth * matrix([-y, x]) / rho * turn
        found = _plane()[1] * offset
        # A turned camera has p - w x p.
        turned = found * matrix([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return [list(each[row, :]) for each in (found, turned) for row in range(2)]


def by_pixel(mirror: str, pixel: list[Any], start: float) -> list[list[Any]]:
    """(6, 2) origins and directions by the pixel."""
    with mp.workdps(40):
        centre, plane = _plane()
        x, y = plane**-1 * (matrix(pixel) - centre)
        radius = hypot(x, y)
        (r, depth, across, _), slopes = _solve(mirror, lambda r, d, *_: r / d - radius, start)
        dr, dd, da, du = (one / ((slopes[0] * depth - r * slopes[1]) / depth**2) for one in slopes)
        c, s = x / radius, y / radius
        outwards = matrix([dr * c, dr * s, -dd, da * c, da * s, du])
        sideways = matrix([-r * s, r * c, 0, -across * s, across * c, 0]) / radius
        found = (outwards * matrix([[c, s]]) + sideways * matrix([[-s, c]])) * plane**-1
        return [list(found[row, :]) for row in range(6)]


def make_mirror(mirror: str) -> NonCentralMirror:
    """The product's mirror."""
    given = {k: tuple(v) if isinstance(v, list) else v for k, v in MIRRORS[mirror].items()}
    made: Any = MODELS[mirror.split()[0]](**given)  # type: ignore[arg-type]
    return made


def _parameters(mirror: str) -> dict[str, Any]:
    """Parameters of the surface next to the axis or apex, at 90 degrees, the rim, and between."""
    rim = mpf(MIRRORS[mirror]["rim_rad"])

    def place(theta: Any) -> Any:
        ends = mpf("1e-30"), mpf(LAST[mirror])
        return findroot(
            lambda p: atan2(*_reflect(mirror, p)[2:]) - theta, ends, solver="anderson", tol=1e-25
        )

    with mp.workdps(40):
        end = place(rim)
        # Next to a cone's apex an angle from the axis has few digits of that from the apex.
        near = "1e-5" if mirror == "conical" else "1e-8"
        return {
            f"{near} of the mirror": end * mpf(near),
            "half way": end / 2,
            "90 degrees": place(pi / 2),
            "next to the rim": end * (1 - mpf("1e-12")),
        }


def rows() -> dict[str, list[dict[str, Any]]]:
    """Cases by formula."""
    found: dict[str, list[dict[str, Any]]] = {"mirror_by_point": [], "mirror_by_pixel": []}
    for mirror in MIRRORS:
        pinhole_m = make_mirror(mirror).pinhole_distance_m
        for place, parameter in _parameters(mirror).items():
            with mp.workdps(40):
                r, depth, across, up = _reflect(mirror, parameter)
                centre, plane = _plane()
                pixel_there = list(centre + plane * matrix(UP) * (r / depth))
            name, given = f"{mirror}, {place}", {"mirror": mirror, "start": float(parameter)}
            for far, distance in DISTANCES_M.items():
                is_far = math.isinf(distance)
                rho, z = across, up
                if not is_far:
                    rho, z = r + distance * across, pinhole_m - depth + distance * up
                point = [float(rho * UP[0]), float(rho * UP[1]), float(z)]
                inputs = {**given, "point": point, "pinhole_m": pinhole_m, "is_far": is_far}
                row = jacobian_case(f"{name}, {far}", inputs, by_point, 2)
                found["mirror_by_point"].append(row)
            inputs = {**given, "pixel": list(map(float, pixel_there))}
            found["mirror_by_pixel"].append(jacobian_case(name, inputs, by_pixel, 3))
    return found


if __name__ == "__main__":
    for formula, cases in rows().items():
        write(GROUP, formula, cases)
