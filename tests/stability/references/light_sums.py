"""Light: ends of the sRGB curve, sums of samples in linear light, inverse squares."""

from __future__ import annotations

import math
from functools import cache
from itertools import product
from typing import Any

from mpmath import atan, exp, mp, mpf, pi, quad, sin, sqrt

from stability.references.writing import case, refusal, write

CURVE = {
    "float64": {"rel": 4e-15, "abs": 1e-16, "reason": "a power, and 0.055 taken from it"},
    "float32": {"rel": 2e-6, "abs": 1e-7, "reason": "a power in float32, and 0.055 taken from it"},
}
# Means and curve are in float64: 1e-9 is far above all their roundings.
GREY = {
    "float64": {"abs": 0.5 + 1e-9, "reason": "half a grey, by rounding to whole greys"},
    "float32": {"abs": 0.5 + 1e-5, "reason": "half a grey, and samples in float32"},
}
LAMP = {
    "float64": {"rel": 4e-15, "reason": "a dozen roundings"},
    "float32": {"rel": 4e-6, "reason": "a dozen roundings"},
}
BAKED = {
    "float64": {"rel": 1e-5, "reason": "16 bits, and bounces that are left out"},
    "float32": {"rel": 1e-5, "reason": "16 bits, and bounces that are left out"},
}
SUNLIGHT = {
    "float64": {"rel": 2e-4, "abs": 1e-9, "reason": "12 steps of a way to the sun; and night"},
    "float32": {"rel": 2e-4, "abs": 1e-9, "reason": "12 steps of a way to the sun; and night"},
}
STATED = {
    "float64": {"abs": 0.01, "reason": "99 of 100 nodes"},
    "float32": {"abs": 0.01, "reason": "99 of 100 nodes"},
}
FORM_FACTOR = {
    "float64": {"rel": 1e-12, "abs": 1e-14, "reason": "sums of angles that cancel"},
    "float32": {"rel": 1e-4, "abs": 1e-6, "reason": "sums of angles that cancel"},
}
KNEE = 0.0031308
LINEAR = {
    "no light": 0.0,
    "the smallest double": 5e-324,
    "1e-9": 1e-9,
    "below the knee": math.nextafter(KNEE, 0.0),
    "the knee": KNEE,
    "above the knee": math.nextafter(KNEE, 1.0),
    "mid grey": 0.18,
    "next to full": math.nextafter(1.0, 0.0),
    "full": 1.0,
    "above full is clipped": 7.5,
    "the largest is clipped": 1.7e308,
    "below nothing is clipped": -1e-3,
}
SAMPLES = {
    "one, no light": ([0.0], 1),
    "one, full": ([1.0], 1),
    "one, twice full is clipped": ([2.0], 1),
    "one, the knee": ([KNEE], 1),
    "256, full": ([1.0], 256),
    "256, no light": ([0.0], 256),
    "4, one of them four times white: their mean is clipped": ([4.0, 0.0, 0.0, 0.0], 4),
    "4, one of them twice white: nothing is clipped": ([2.0, 0.0, 0.0, 0.0], 4),
    "4, black beside white: a mean of light, not of greys": ([0.0, 1.0, 1.0, 0.0], 4),
    "9, one of them full": ([1.0, *[0.0] * 8], 9),
    "25, dark": ([1e-4], 25),
}


def curve_rows() -> list[dict[str, Any]]:
    """Cases of srgb_from_linear."""
    return [
        *(
            case(name, {"linear": linear}, exact=encode, tolerance=CURVE)
            for name, linear in LINEAR.items()
        ),
        refusal("no number", {"linear": math.nan}, expect="error", which="light"),
    ]


def sum_rows() -> list[dict[str, Any]]:
    """Cases of the reference's pixels: red has the samples, green is full, blue is dark."""
    values = [
        case(name, {"red": red, "samples": samples}, exact=greys, tolerance=GREY)
        for name, (red, samples) in SAMPLES.items()
    ]
    nothing = {"red": [math.nan], "samples": 1}
    return [*values, refusal("no number", nothing, expect="error", which="light")]


def lamp_rows() -> list[dict[str, Any]]:
    """Cases of point_irradiance: a point light over a floor that faces the light."""
    heights = {"a metre": 1.0, "a millimetre": 1e-3, "at the lamp's own millimetre": 1.0000001e-3}
    far = {"10 km": 1e4, "1e100 m": 1e100}
    return [
        case(name, {"height_m": height}, exact=irradiance, tolerance=LAMP)
        for name, height in {**heights, **far}.items()
    ] + [case("within the millimetre", {"height_m": 1e-9}, exact=within, tolerance=LAMP)]


def furnace_rows() -> list[dict[str, Any]]:
    """Cases of baked light: a closed room of one albedo, all of which emits the radiance 1."""
    albedos = {"black walls": 0.0, "grey walls": 0.5, "white walls": 0.875}
    return [
        case(name, {"albedo": albedo}, exact=furnace, tolerance=BAKED)
        for name, albedo in albedos.items()
    ]


def sunlight_rows() -> list[dict[str, Any]]:
    """Cases of a sky's sun, from below the horizon to the zenith, in clear air and in haze."""
    return [
        case(
            f"{elevation:g} degrees, turbidity {turbidity:g}",
            {"elevation_deg": elevation, "turbidity": turbidity},
            exact=sunlight,
            tolerance=SUNLIGHT,
        )
        for elevation, turbidity in product(
            (-2.0, 0.0, 1.0, 5.0, 30.0, 90.0), (1.0, 2.0, 4.0, 7.0, 10.0)
        )
    ]


def stated_rows() -> list[dict[str, Any]]:
    """Cases of the stated error of baked light: a rectangle over a floor, without a reflection."""
    names = ("distance_m", "half_x_m", "half_y_m")
    lamps = {
        "a lamp in a room": (2.0, 0.3, 0.2),
        "a large window": (1.0, 1.0, 1.0),
        "close to the floor": (0.3, 0.3, 0.2),
        "a small lamp": (1.0, 1e-3, 1e-3),
        "a tube": (1.0, 0.6, 0.01),
    }
    return [
        case(name, dict(zip(names, lamp, strict=True)), exact=none_beyond, tolerance=STATED)
        for name, lamp in lamps.items()
    ]


def beside_rows() -> list[dict[str, Any]]:
    """Cases of a box before a point whose horizon cuts it: a robot beside a spot of the floor."""
    names = ("distance_m", "half_width_m", "height_m", "below_m")
    boxes = {
        "a robot on the floor": (0.3, 0.25, 0.3, 0.0),
        "a millimetre before it": (1e-3, 0.25, 0.3, 0.0),
        "at the end of its shade": (0.8, 0.25, 0.3, 0.0),
        "half below the horizon": (0.3, 0.25, 0.15, 0.15),
        "almost all below the horizon": (0.3, 0.25, 1e-6, 0.3),
        "a wall": (0.3, 50.0, 50.0, 0.0),
        "far away": (1e3, 0.25, 0.3, 0.0),
    }
    return [
        case(name, dict(zip(names, box, strict=True)), exact=beside, tolerance=FORM_FACTOR)
        for name, box in boxes.items()
    ]


def above_rows() -> list[dict[str, Any]]:
    """Cases of a box over a point, or before one that faces it."""
    names = ("distance_m", "half_x_m", "half_y_m")
    boxes = {
        "below a robot": (0.1, 0.25, 0.3),
        "a tenth of a millimetre below": (1e-4, 0.25, 0.3),
        "far below": (1e3, 0.25, 0.3),
        "a narrow beam": (0.1, 1e-3, 0.3),
    }
    return [
        case(name, dict(zip(names, box, strict=True)), exact=above, tolerance=FORM_FACTOR)
        for name, box in boxes.items()
    ]


def beside(distance_m: Any, half_width_m: Any, height_m: Any, below_m: Any) -> Any:
    """Twice a rectangle perpendicular to the point's plane: Howell's catalogue, C-4."""
    x, y = height_m / half_width_m, distance_m / half_width_m
    root = sqrt(x**2 + y**2)
    return (atan(1 / y) - y / root * atan(1 / root)) / pi + 0 * below_m


def above(distance_m: Any, half_x_m: Any, half_y_m: Any) -> Any:
    """Four parallel rectangles whose corners are over the point: Howell's catalogue, C-3."""
    x, y = half_x_m / distance_m, half_y_m / distance_m
    of_x, of_y = sqrt(1 + x**2), sqrt(1 + y**2)
    return 2 / pi * (x / of_x * atan(y / of_x) + y / of_y * atan(x / of_y))


def furnace(albedo: Any) -> Any:
    """The sum of all bounces: 1 + albedo + albedo^2 and so on."""
    return 1 / (1 - albedo)


def sunlight(elevation_deg: Any, turbidity: Any) -> list[Any]:
    """Irradiance of 1.44 that is left of red, green and blue sunlight 2 m above the sea.

    Rayleigh scattering per metre of air with a scale height of 8 km up to 100 km; haze of 1.2 km,
    whose optical thickness for green is the turbidity less 1 times that of the air, and 1.1 times
    with what it absorbs.
    """
    if elevation_deg < mpf("-0.05"):
        return [mpf(0)] * 3
    air, small = depths(elevation_deg)
    rayleigh = [mpf(text) for text in ("5.8e-6", "13.5e-6", "33.1e-6")]
    haze = mpf("1.1") * (turbidity - 1) * rayleigh[1] * mpf(8000) / 1200
    return [mpf("1.44") * exp(-air * beta - small * haze) for beta in rayleigh]


@cache
def depths(elevation_deg: Any) -> tuple[Any, Any]:
    """Metres of air of sea level, and of haze, on the way from 2 m above the sea to the sun."""
    with mp.workdps(60):
        earth, slope = mpf(6371000), sin(elevation_deg * pi / 180)
        eye = earth + 2
        far = sqrt((eye * slope) ** 2 + (earth + 100000) ** 2 - eye**2) - eye * slope
        ends = [0, *(far * mpf(2) ** -step for step in range(9, -1, -1))]

        def depth(scale: int) -> Any:
            return quad(
                lambda s: exp((earth - sqrt(eye**2 + s * (s + 2 * eye * slope))) / scale), ends
            )

        return depth(8000), depth(1200)


def none_beyond(distance_m: Any, half_x_m: Any, half_y_m: Any) -> Any:
    """0 of all nodes."""
    return mpf(0) * distance_m * half_x_m * half_y_m


def encode(linear: Any) -> Any:
    """IEC 61966-2-1's curve of light clipped to [0, 1]."""
    light = min(max(linear, mpf(0)), mpf(1))
    if light <= mpf("0.0031308"):
        return mpf("12.92") * light
    return mpf("1.055") * light ** (1 / mpf("2.4")) - mpf("0.055")


def greys(red: list[Any], samples: int) -> list[Any]:
    """Grey of the mean of the samples' light, which is clipped; the list is repeated."""
    mean = sum(red) / len(red)
    return [255 * encode(mean), mpf(255), mpf(0)]


def irradiance(height_m: Any) -> Any:
    """1 / d^2 straight below a unit point light."""
    return 1 / height_m**2


def within(height_m: Any) -> Any:
    """Irradiance within a millimetre of a light, by definition: cosine d / 1 mm, as from 1 mm."""
    return height_m / sqrt(mpf("1e-6")) / mpf("1e-6")


if __name__ == "__main__":
    write("light", "srgb_from_linear", curve_rows())
    write("light", "sample_sums", sum_rows())
    write("light", "point_irradiance", lamp_rows())
    write("light", "furnace", furnace_rows())
    write("light", "sunlight", sunlight_rows())
    write("light", "probe", furnace_rows())
    write("light", "beyond_stated", stated_rows())
    write("light", "box_beside", beside_rows())
    write("light", "box_above", above_rows())
