"""Ranges from the direction to a point of known height, and sigmas with the paper's mirror."""

from __future__ import annotations

import math
from typing import Any

from mpmath import mpf, sqrt

from stability.references.motion import relative
from stability.references.writing import case, refusal, write

K, HORIZON_PX = 11.546, 103.45267


def range_from_half_angle(t: Any, drop: Any) -> Any:
    """Drop tan(theta)."""
    return drop * 2 * t / (1 - t**2)


def half_angle(range_: Any, drop: Any) -> Any:
    """Tan(theta / 2)."""
    return range_ / (sqrt(range_**2 + drop**2) + drop)


def incidence_angle_sigma(range_: Any, drop: Any, sigma: Any) -> Any:
    """Sigma of theta: the image radius is h 2 kappa s t / (1 - kappa^2 t^2)."""
    k, t = mpf(K), half_angle(range_, drop)
    s = sqrt(k * (k - 2))
    kappa = 1 / (k - 1 + s)
    by_t = 2 * kappa * s * (1 + kappa**2 * t**2) / (1 - kappa**2 * t**2) ** 2
    return sigma / (mpf(HORIZON_PX) * by_t * (1 + t**2) / 2)


def range_sigma(range_: Any, drop: Any, sigma: Any) -> Any:
    """(drop^2 + r^2) / |drop| sigma of theta."""
    return (drop**2 + range_**2) / abs(drop) * incidence_angle_sigma(range_, drop, sigma)


def azimuth_sigma(range_: Any, drop: Any, sigma: Any) -> Any:
    """Image's sigma over the image radius."""
    k, t = mpf(K), half_angle(range_, drop)
    s = sqrt(k * (k - 2))
    kappa = 1 / (k - 1 + s)
    return sigma * (1 - kappa**2 * t**2) / (mpf(HORIZON_PX) * 2 * kappa * s * t)


HALF_ANGLES = {
    "straight below": (0.0, 0.6),
    "almost straight below": (1e-300, 0.6),
    "45 degrees": (math.tan(math.pi / 8), 0.6),
    "an ulp below the horizon": (math.nextafter(1.0, 0.0), 0.6),
    "an ulp above the horizon": (math.nextafter(1.0, 2.0), -0.6),
    "above the horizon": (1.5, -0.4),
    "almost straight above": (1e200, -0.4),
    "a tiny height": (0.999, 1e-300),
    "a huge height": (0.5, 1e300),
}
NO_RANGE = {
    "the horizon": (1.0, 0.6),
    "above the horizon a point below": (1.1, 0.6),
    "below the horizon a point above": (0.9, -0.6),
    "no height": (0.5, 0.0),
    "a negative half angle": (-0.1, 0.6),
    "straight above": (math.inf, -0.6),
    "not a number": (math.nan, 0.6),
    "height not a number": (0.5, math.nan),
    "too large": (math.nextafter(1.0, 0.0), 1e300),
}
PLACES = {
    "a foot at 0.5 m": (0.5, 0.6),
    "a foot at 3 m": (3.0, 0.6),
    "near the horizon": (2.0, 1e-6),
    "a tiny height": (2.0, 1e-200),
    "at the horizon from above": (2.0, -1e-6),
    "above the viewpoint": (2.0, -0.4),
    "a kilometre off": (1000.0, 0.6),
    "1e150 m off": (1e150, 0.6),
    "a centimetre off": (0.01, 0.6),
    "almost straight below": (1e-12, 0.6),
    "everything tiny": (3e-200, 4e-200),
}


def main() -> None:
    """Write the cases of the group."""
    near = relative(1e-14, "a dozen roundings of well-conditioned terms")
    rows = [
        case(n, {"t": t, "drop": d}, exact=range_from_half_angle, tolerance=near)
        for n, (t, d) in HALF_ANGLES.items()
    ]
    rows += [
        refusal(n, {"t": t, "drop": d}, expect="invalid", which="")
        for n, (t, d) in NO_RANGE.items()
    ]
    write("ranging", "range_from_half_angle", rows)
    _write_sigmas(near)


def _write_sigmas(near: dict[str, Any]) -> None:
    sigmas = {
        "incidence_angle_sigma": incidence_angle_sigma,
        "range_sigma": range_sigma,
        "azimuth_sigma": azimuth_sigma,
    }
    for formula, exact in sigmas.items():
        rows = [
            case(n, {"range_": r, "drop": d, "sigma": 0.5}, exact=exact, tolerance=near)
            for n, (r, d) in PLACES.items()
            if (formula, n) != ("range_sigma", "a tiny height")
        ]
        invalid = {"the viewpoint": (0.0, 0.0), "beyond the mirror's reach": (0.1, -0.6)}
        if formula == "range_sigma":
            invalid |= {"no height": (2.0, 0.0), "too large": (1e10, 1e-300)}
        if formula == "azimuth_sigma":
            invalid |= {"straight below": (0.0, 0.6)}
        rows += [
            refusal(n, {"range_": r, "drop": d, "sigma": 0.5}, expect="invalid", which="")
            for n, (r, d) in invalid.items()
        ]
        write("ranging", formula, rows)


if __name__ == "__main__":
    main()
