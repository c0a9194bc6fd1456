"""Numbers on the wire: truncated, never rounded, without an exponent; and parsed from any text.

The printed text is written here by hand or by Decimal; its value is the reference.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from decimal import Decimal
from typing import Any

from mpmath import floor, mpf

from stability.references.mirror_exact import LARGEST
from stability.references.writing import case, float64_case, refusal, write

EXACT = {"float64": {"abs": 0.0, "reason": "a text is a text"}}
ROUNDED = {
    "float64": {"ulp": 0.5, "abs": 5e-324, "reason": "the double nearest to the text"},
    "float32": {"ulp": 0.5, "reason": "the float nearest to the text"},
}
QUOTIENT = {
    "float64": {"rel": 3e-16, "reason": "a rounded constant and a rounded quotient"},
    "float32": {"rel": 1.2e-7, "reason": "the rounding of the result"},
}
UNITS_PER_RAD = mpf("10430.3783505")  # UnitsConverter.uc's own constant, exactly

# value, decimals, text
PRINTED = {
    "pi": (math.pi, 4, "3.1415"),
    "minus pi": (-math.pi, 4, "-3.1415"),
    "5.385, whose double is below it": (5.385, 4, "5.3850"),
    "0.29, times 100 is 28.999": (0.29, 2, "0.29"),
    "0.1 + 0.2": (0.1 + 0.2, 4, "0.3000"),
    "next to 1 from below": (math.nextafter(1.0, 0.0), 4, "0.9999"),
    "half a unit of the last place": (0.00005, 4, "0.0000"),
    "minus zero": (-0.0, 2, "-0.00"),
    "next to minus zero": (-0.001, 2, "-0.00"),
    "the smallest double": (5e-324, 4, "0.0000"),
    "minus the smallest double": (-5e-324, 4, "-0.0000"),
    "1e16, where printf turns to exponents": (1e16, 4, "10000000000000000.0000"),
    "1e22": (1e22, 2, "1" + "0" * 22 + ".00"),
    "the largest double": (LARGEST, 0, format(Decimal(repr(LARGEST)), "f").split(".")[0]),
    "without decimals": (-2.999, 0, "-2"),
}
READ = {
    "a number": ("1.5", 1.5),
    "no digits before the point": ("-.4", -0.4),
    "an exponent": ("1.5e-3", 1.5e-3),
    "a unit behind it": ("1.5m", 1.5),
    "beyond the largest": ("1e999", LARGEST),
    "400 digits": ("9" * 400, LARGEST),
    "below the smallest": ("1e-999", 0.0),
    "the smallest double": ("5e-324", 5e-324),
    "nan": ("NaN", 0.0),
    "infinity": ("-infinity", 0.0),
    "no number": ("abc", 0.0),
    "nothing": ("", 0.0),
}


def printed_rows() -> list[dict[str, Any]]:
    """Cases of format_fixed_point."""
    values = [
        float64_case(
            name,
            {"value": value, "decimals": decimals, "text": text},
            exact=_value_of_text,
            tolerance=_within_rounding(text),
        )
        for name, (value, decimals, text) in PRINTED.items()
    ]
    refused = [
        refusal(
            f"{value}",
            {"value": value, "decimals": 4, "text": ""},
            expect="error",
            which="only finite",
        )
        for value in (math.nan, math.inf, -math.inf)
    ]
    return [*values, *refused]


def read_rows() -> list[dict[str, Any]]:
    """Cases of number_from_text."""
    return [
        float64_case(
            name, {"text": text}, exact=_always(value), tolerance=ROUNDED if value else EXACT
        )
        for name, (text, value) in READ.items()
    ]


def angle_rows() -> list[dict[str, Any]]:
    """Cases of truncate_to_unreal_units."""
    values = {"pi": math.pi, "3.14159": 3.14159, "minus": -0.01745, "zero": 0.0, "1e-320": 1e-320}
    return [
        *(
            float64_case(name, {"angle_rad": angle}, exact=whole_units, tolerance=QUOTIENT)
            for name, angle in values.items()
        ),
        *(
            refusal(name, {"angle_rad": angle}, expect="error", which="Unreal units")
            for name, angle in {"1e308": 1e308, "nan": math.nan, "inf": math.inf}.items()
        ),
    ]


def length_rows() -> list[dict[str, Any]]:
    """Cases of metres_from_uu."""
    values = {"a metre": 250.0, "minus a third": -1.0 / 3.0, "1e-300": 1e-300, "largest": LARGEST}
    return [
        *(
            case(name, {"length_uu": length}, exact=_metres, tolerance=QUOTIENT)
            for name, length in values.items()
        ),
        refusal("nan", {"length_uu": math.nan}, expect="error", which="no length"),
        refusal("infinite", {"length_uu": math.inf}, expect="error", which="no length"),
    ]


def whole_units(angle_rad: Any) -> Any:
    """Angle in whole units, truncated towards zero."""
    units = abs(angle_rad) * UNITS_PER_RAD
    return floor(units) / UNITS_PER_RAD * (1 if angle_rad >= 0 else -1)


def _metres(length_uu: Any) -> Any:
    return length_uu / 250


def _value_of_text(value: Any, decimals: int, text: str) -> Any:
    return mpf(text)


def _always(value: float) -> Callable[..., Any]:
    return lambda text: mpf(value)


def _within_rounding(text: str) -> dict[str, Any]:
    """Half an ulp: texts are compared literally, values as nearest floats."""
    return ROUNDED if float(text) else EXACT


if __name__ == "__main__":
    write("wire", "fixed", printed_rows())
    write("wire", "number_from_text", read_rows())
    write("wire", "unreal_angle", angle_rows())
    write("wire", "metres_from_uu", length_rows())
