"""Numbers of ini files: the literals of UnrealScript, and ranges in words."""

from __future__ import annotations

import math

# Bound of all numbers: squares and products of a few stay finite in float32, too. A
# robot's battery of 30 years has 1e9 s; no length, mass or angle of a real file is near.
MAX_NUMBER = 1e9


def parse_number(text: str) -> float | None:
    """Finite number of a literal; None for any other text."""
    # UnrealScript's literals may end in f. "nan", "inf" and their kin, which float() would accept,
    # are no numbers in an ini file.
    try:
        value = float(text.rstrip("fF")) if text[:1] not in "nNiI" else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def describe_range(kind: str, min_value: float, max_value: float) -> str:
    """Kind of number with its bounds: "a number from 0 to 10"."""
    if math.isinf(min_value) and math.isinf(max_value):
        return kind
    # 2^31 is the default bound of get_int, which no user set: naming it would puzzle.
    if math.isinf(max_value) or max_value == 2**31:
        return f"{kind} of at least {min_value:g}"
    if math.isinf(min_value):
        return f"{kind} of at most {max_value:g}"
    return f"{kind} from {min_value:g} to {max_value:g}"
