"""Values of recipes that other ini files do not have: ranges, and lists of words."""

from __future__ import annotations

import math
from collections.abc import Sequence

from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.unknown_names import suggest_name
from catoptra_server.datasets.recipe import ValueRange

_EXAMPLE = "(Min=0,Max=1)"


def read_range(
    section: SectionReader,
    key: str,
    default: ValueRange,
    *,
    min_value: float = -math.inf,
    max_value: float = math.inf,
) -> ValueRange:
    """Range of a number: a struct such as (Min=0,Max=1), or one number for a fixed value.

    Args:
        section: The section.
        key: The key, in any case.
        default: Result for a missing key, not checked against the bounds.
        min_value: Smallest accepted value.
        max_value: Largest accepted value.

    Raises:
        ConfigError: For no range, one beyond the bounds, or an empty one.
    """
    text = section.get_str(key, "")
    if not text:
        return default
    if not text.startswith("("):
        value = section.get_float(key, min_value=min_value, max_value=max_value)
        return ValueRange(value, value)
    return read_range_struct(
        section, key, section.get_struct(key, example=_EXAMPLE), min_value, max_value
    )


def read_range_struct(
    section: SectionReader,
    key: str,
    struct: SectionReader,
    min_value: float = -math.inf,
    max_value: float = math.inf,
) -> ValueRange:
    """Range of a struct with Min and Max."""
    low = struct.get_float("Min", min_value=min_value, max_value=max_value)
    high = struct.get_float("Max", min_value=min_value, max_value=max_value)
    if low > high:
        raise section.make_error(key, expected=f"a range with Min at most Max, as {_EXAMPLE}")
    return ValueRange(low, high)


def read_words(
    section: SectionReader, key: str, allowed: Sequence[str], default: tuple[str, ...]
) -> tuple[str, ...]:
    """Words with commas between, each once, in the order of `allowed`; `all` for all of them.

    Raises:
        ConfigError: For an unknown word, with the one that was probably meant.
    """
    if not section.get_str(key, ""):
        return default
    words = [word.strip().lower() for word in section.get_str(key).split(",") if word.strip()]
    if words == ["all"]:
        return tuple(allowed)
    for word in words:
        if word not in allowed:
            close = suggest_name(word, allowed)
            hint = f"; did you mean {close}?" if close else ""
            expected = f"words of {', '.join(allowed)}, with commas between, or all{hint}"
            raise section.make_error(key, expected=expected)
    return tuple(word for word in allowed if word in words)
