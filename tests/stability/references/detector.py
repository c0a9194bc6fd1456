"""Beacon near the horizon: does the measurement have a range (1) or a bearing alone (0)?

A range needs three sigma of the incidence angle between the lower band and the horizon, and a sigma
of at most a fifth of the range; that sigma combines 0.2 px of the image radius with a tenth of the
beacon's radius, 0.05 m.
"""

from __future__ import annotations

from typing import Any

from mpmath import atan2, hypot, mpf, pi

from stability.references.ranging import incidence_angle_sigma, range_sigma
from stability.references.writing import case, float64_case, refusal, write


def has_range(range_: Any, drop: Any) -> Any:
    """1 if a lower band at this range, this far below the viewpoint, gives a range."""
    sigma_px, radius = mpf(0.2), mpf(0.05)
    clear = atan2(abs(drop), range_) > 3 * incidence_angle_sigma(range_, drop, sigma_px)
    along = hypot(range_sigma(range_, drop, sigma_px), radius / 10)
    return mpf(clear and along <= (range_ + radius * pi / 4) / 5)


PLACES = {
    "a usual place": (2.0, 0.375),
    "at 5 m": (5.0, 0.375),
    "above the viewpoint": (2.0, -0.2),
    "barely below the horizon": (2.0, 1e-6),
    "1e-12 m below the horizon": (2.0, 1e-12),
    "1e-12 m above it": (2.0, -1e-12),
    "just clear enough at 2 m": (2.0, 0.0204),
    "just not clear enough at 2 m": (2.0, 0.0190),
    "just clear enough from below": (2.0, -0.0205),
    "just not clear enough from below": (2.0, -0.0188),
    "near and a centimetre below": (0.5, 0.01),
    "near and a millimetre below": (0.5, 0.001),
}
EXACT = {"float64": {"abs": 0.0, "reason": "a decision"}, "float32": {"abs": 0.0, "reason": "same"}}


def main() -> None:
    """Write the cases of the group."""
    rows = [
        (float64_case if abs(drop) < 1e-9 else case)(
            name, {"range_": r, "drop": drop}, exact=has_range, tolerance=EXACT
        )
        for name, (r, drop) in PLACES.items()
    ]
    rows.append(
        refusal("at the horizon", {"range_": 2.0, "drop": 0.0}, expect="invalid", which="no beacon")
    )
    write("detector", "has_range", rows)


if __name__ == "__main__":
    main()
