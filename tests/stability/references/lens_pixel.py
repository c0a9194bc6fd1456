"""The ordinary camera: pixel of a direction and back, borders, fields of view at their ends."""

from __future__ import annotations

import math
from typing import Any

from mpmath import sqrt, tan

from stability.references.mirror_exact import LARGEST
from stability.references.omni_pixel import PIXELS, UNITS
from stability.references.writing import case, float64_case, refusal, write

WIDE, NARROW = math.radians(90.0), 1e-6
NEXT_TO_180 = math.nextafter(math.pi, 0.0)


def direction_rows() -> list[dict[str, Any]]:
    """Cases of pixel_from_direction."""
    values = [
        _pixel("the axis", (640, 480, WIDE), [1.0, 0.0, 0.0]),
        _pixel("the axis of an odd picture", (641, 3, WIDE), [2.0, 0.0, 0.0]),
        _pixel("the axis of 1 x 1", (1, 1, WIDE), [1.0, 0.0, 0.0]),
        _pixel("within the right border", (640, 480, WIDE), [1.0, 0.999, 0.5]),
        _pixel("1e-300 beside the axis", (640, 480, WIDE), [1.0, 1e-300, -1e-300]),
        _pixel("a vector of denormals", (640, 480, WIDE), [5e-324, 0.0, 0.0]),
        _pixel("the largest doubles", (640, 480, WIDE), [LARGEST, -0.5 * LARGEST, 0.25 * LARGEST]),
        _pixel("a field of a microradian", (640, 480, NARROW), [1.0, 1e-7, -1e-7]),
    ]
    unseen = {
        "beyond the right border": [1.0, 1.001, 0.0],
        "beside": [0.0, 1.0, 0.0],
        "behind": [-1.0, 0.0, 0.0],
        "the zero vector": [0.0, 0.0, 0.0],
        "next to beside": [1e-300, 1.0, 1.0],
        "infinite": [math.inf, 0.0, 0.0],
        "no number": [1.0, math.nan, 0.0],
    }
    refused = [
        refusal(name, {**camera((640, 480, WIDE)), "direction": at}, expect="invalid", which="")
        for name, at in unseen.items()
    ]
    return [*values, *refused]


def pixel_rows() -> list[dict[str, Any]]:
    """Cases of direction_from_pixel."""
    values = [
        _direction("the middle", (640, 480, WIDE), [320.0, 240.0]),
        _direction("a corner", (640, 480, WIDE), [0.0, 480.0]),
        _direction("the middle of 1 x 1", (1, 1, WIDE), [0.5, 0.5]),
        # In float32 the next number below pi is above it in float64: no field of view.
        float64_case(
            "a field next to 180 degrees, the border",
            {**camera((640, 480, NEXT_TO_180)), "pixel": [0.0, 240.0]},
            exact=direction,
            tolerance=UNITS,
        ),
        _direction("a field of a microradian", (640, 480, NARROW), [1.0, 1.0]),
    ]
    return [*values, *_unseen(), *_impossible()]


def _unseen() -> list[dict[str, Any]]:
    unseen = {
        "left of the picture": [-0.001, 240.0],
        "below the picture": [320.0, 480.001],
        "the largest doubles": [LARGEST, -LARGEST],
        "infinite": [math.inf, 240.0],
        "no number": [math.nan, math.nan],
    }
    return [
        refusal(name, {**camera((640, 480, WIDE)), "pixel": at}, expect="invalid", which="")
        for name, at in unseen.items()
    ]


def _impossible() -> list[dict[str, Any]]:
    fields = {
        "180 degrees": math.pi,
        "0 degrees": 0.0,
        "a denormal field": 5e-324,
        "no number": math.nan,
    }
    at = [320.0, 240.0]
    return [
        refusal(
            f"a field of {name}",
            {**camera((640, 480, fov)), "pixel": at},
            expect="error",
            which="field of view",
        )
        for name, fov in fields.items()
    ]


def camera(values: tuple[int, int, float]) -> dict[str, Any]:
    """Inputs that describe a camera."""
    return dict(zip(("width_px", "height_px", "fov_rad"), values, strict=True))


def pixel(direction: list[Any], **of: Any) -> list[Any]:
    """[u, v]."""
    x, y, z = direction
    focal = of["width_px"] / (2 * tan(of["fov_rad"] / 2))
    return [focal * y / x + of["width_px"] / 2.0, focal * z / x + of["height_px"] / 2.0]


def direction(pixel: list[Any], **of: Any) -> list[Any]:
    """Unit [x, y, z]."""
    focal = of["width_px"] / (2 * tan(of["fov_rad"] / 2))
    y, z = pixel[0] - of["width_px"] / 2.0, pixel[1] - of["height_px"] / 2.0
    length = sqrt(focal**2 + y**2 + z**2)
    return [focal / length, y / length, z / length]


def _pixel(name: str, values: tuple[int, int, float], at: list[float]) -> dict[str, Any]:
    return case(name, {**camera(values), "direction": at}, exact=pixel, tolerance=PIXELS)


def _direction(name: str, values: tuple[int, int, float], at: list[float]) -> dict[str, Any]:
    return case(name, {**camera(values), "pixel": at}, exact=direction, tolerance=UNITS)


if __name__ == "__main__":
    write("lens", "perspective_pixel", direction_rows())
    write("lens", "perspective_direction", pixel_rows())
