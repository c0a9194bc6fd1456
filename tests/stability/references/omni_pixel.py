"""Pixel of a direction and direction of a pixel, through the angles: centre, rim, extremes."""

from __future__ import annotations

import math
from typing import Any

from mpmath import atan, cos, sin, sqrt

from stability.references.half_angle import tangent
from stability.references.mirror_exact import LARGEST, PAPER_K, radius_ratio, t_of_ratio
from stability.references.writing import case, refusal, write

PIXELS = {
    "float64": {"abs": 1e-12, "reason": "an ulp of 640 px is 1.1e-13"},
    "float32": {
        "abs": 4e-4,
        "reason": "an ulp of 640 px is 6e-5, over a dozen roundings",
    },
}
UNITS = {
    "float64": {"abs": 2e-15, "reason": "pixels are known to 1e-13 of some 100 px a radian"},
    "float32": {"abs": 4e-6, "reason": "pixels are known to 6e-5 of some 100 px a radian"},
}
# width, height, centre, horizon radius, rim, the azimuth that points up.
EVEN = (360, 360, [180.0, 180.0], 103.5, math.radians(120.0), 0.0)
ODD = (361, 181, [180.5, 90.5], 52.0, math.radians(120.0), 0.0)
TINY = (1, 1, [0.5, 0.5], 0.28735, math.radians(120.0), 0.0)
TURNED = (640, 480, [319.25, 244.5], 138.0, math.radians(119.0), 2.1)
NAMES = ("width_px", "height_px", "centre_px", "horizon_px", "rim_rad", "up_rad")
CAMERAS = {"even": EVEN, "odd": ODD, "1 x 1": TINY, "turned": TURNED}


def camera(values: tuple[Any, ...]) -> dict[str, Any]:
    """Inputs that describe a camera with the paper's mirror."""
    return {"k": PAPER_K, **dict(zip(NAMES, values, strict=True))}


def direction_rows() -> list[dict[str, Any]]:
    """Cases of pixel_from_direction."""
    theta = math.radians(119.9)
    hard = {
        "the axis": [0.0, 0.0, 2.0],
        "1e-300 beside the axis": [1e-300, 0.0, 1.0],
        "1e-8 beside the axis": [1e-8, -1e-8, 1.0],
        "the horizon": [0.6, -0.8, 0.0],
        "a vector of denormals": [5e-324, 5e-324, 5e-324],
        "a vector of the largest doubles": [LARGEST, -LARGEST, LARGEST],
        "a tenth of a degree within the rim": [math.sin(theta), 0.0, math.cos(theta)],
    }
    values = [_pixel(name, EVEN, direction) for name, direction in hard.items()]
    others = [
        _pixel(f"{name}: {place}", CAMERAS[name], direction)
        for name in ("odd", "1 x 1", "turned")
        for place, direction in {"the axis": [0.0, 0.0, 1.0], "aside": [0.3, -0.4, 0.2]}.items()
    ]
    return [*values, *others, *_unseen_directions()]


def pixel_rows() -> list[dict[str, Any]]:
    """Cases of direction_from_pixel."""
    hard = {
        "the centre": [180.0, 180.0],
        "an ulp beside the centre": [math.nextafter(180.0, 0.0), 180.0],
        "the horizon circle": [283.5, 180.0],
        "within the rim circle": [180.0, 1.0],
    }
    values = [_direction(name, EVEN, pixel) for name, pixel in hard.items()]
    others = [
        _direction("odd: the centre", ODD, [180.5, 90.5]),
        _direction("odd: the middle pixel's corner", ODD, [180.0, 90.0]),
        _direction("1 x 1: the only pixel's centre", TINY, [0.5, 0.5]),
        _direction("1 x 1: a quarter beside it", TINY, [0.25, 0.5]),
        _direction("turned: aside", TURNED, [200.0, 300.0]),
    ]
    return [*values, *others, *_unseen_pixels()]


def pixel(direction: list[Any], **of: Any) -> list[Any]:
    """[u, v]."""
    x, y, _ = direction
    rho = sqrt(x * x + y * y)
    radius = of["horizon_px"] * radius_ratio(of["k"], tangent(direction)) if rho else 0
    x, y = (x / rho, y / rho) if rho else (x, y)
    up = of["up_rad"]
    u, v = of["centre_px"]
    return [u + radius * (sin(up) * x - cos(up) * y), v - radius * (cos(up) * x + sin(up) * y)]


def direction(pixel: list[Any], **of: Any) -> list[Any]:
    """Unit [x, y, z]."""
    du, dv = pixel[0] - of["centre_px"][0], pixel[1] - of["centre_px"][1]
    radius = sqrt(du * du + dv * dv)
    if not radius:
        return [radius, radius, radius + 1]
    theta = 2 * atan(t_of_ratio(of["k"], radius / of["horizon_px"]))
    up = of["up_rad"]
    x, y = (sin(up) * du - cos(up) * dv) / radius, -(cos(up) * du + sin(up) * dv) / radius
    return [sin(theta) * x, sin(theta) * y, cos(theta)]


def _pixel(name: str, values: tuple[Any, ...], at: list[float]) -> dict[str, Any]:
    inputs = {**camera(values), "direction": at}
    return case(name, inputs, exact=pixel, tolerance=PIXELS)


def _direction(name: str, values: tuple[Any, ...], at: list[float]) -> dict[str, Any]:
    inputs = {**camera(values), "pixel": at}
    return case(name, inputs, exact=direction, tolerance=UNITS)


def _unseen_directions() -> list[dict[str, Any]]:
    theta = math.radians(120.1)
    unseen = {
        "a tenth of a degree beyond the rim": [math.sin(theta), 0.0, math.cos(theta)],
        "the antipode": [0.0, 0.0, -1.0],
        "the zero vector": [0.0, 0.0, 0.0],
        "x infinite": [math.inf, 0.0, 0.0],
        "all infinite": [math.inf, math.inf, math.inf],
        "no number": [math.nan, 0.0, 1.0],
    }
    return [
        refusal(name, {**camera(EVEN), "direction": at}, expect="invalid", which="")
        for name, at in unseen.items()
    ]


def _unseen_pixels() -> list[dict[str, Any]]:
    unseen = {
        "a corner of the picture": [0.5, 0.5],
        "a pixel beyond the rim circle": [180.0, -1.5],
        "1e9 px away": [1e9, 180.0],
        "the largest doubles": [LARGEST, -LARGEST],
        "u infinite": [math.inf, 180.0],
        "v no number": [180.0, math.nan],
    }
    refused = [
        refusal(name, {**camera(EVEN), "pixel": at}, expect="invalid", which="")
        for name, at in unseen.items()
    ]
    return [*refused, *_impossible_cameras()]


def _impossible_cameras() -> list[dict[str, Any]]:
    centre = [180.0, 180.0]
    wrong = {
        "no columns": ((0, 360, centre, 103.5, 2.0, 0.0), "no pixel"),
        "a horizon circle of 0": ((360, 360, centre, 0.0, 2.0, 0.0), "radius > 0"),
        "a centre that is no number": ((9, 9, [math.nan, 4.5], 2.0, 2.0, 0.0), "centre"),
        "an infinite azimuth": ((9, 9, [4.5, 4.5], 2.0, 2.0, math.inf), "azimuth"),
        "a rim beyond the asymptote": ((360, 360, centre, 103.5, 2.9, 0.0), "beyond"),
        "a rim that is no number": ((360, 360, centre, 103.5, math.nan, 0.0), "beyond"),
    }
    return [
        refusal(name, {**camera(values), "pixel": centre}, expect="error", which=which)
        for name, (values, which) in wrong.items()
    ]


if __name__ == "__main__":
    write("pixel", "pixel_from_direction", direction_rows())
    write("pixel", "direction_from_pixel", pixel_rows())
