"""Numbers as printed and parsed by USARSim."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.usarsim.value_format import (
    boolean_from_text,
    format_boolean,
    format_fixed_point,
    format_rounded_vector,
    format_vector,
    is_number,
    number_from_text,
    numbers_from_text,
    vector_from_text,
)

DETERMINISTIC = settings(derandomize=True, max_examples=300, deadline=None)


@DETERMINISTIC
@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(0, 8))
def test_fixed_point_when_printed_is_never_further_from_zero(value: float, decimals: int) -> None:
    printed = format_fixed_point(value, decimals)
    assert "e" not in printed
    assert abs(float(printed)) <= abs(value)
    # Truncation loses less than one unit of the last place; the rest is the double's own rounding.
    assert abs(value) - abs(float(printed)) <= 10.0**-decimals + math.ulp(value)


def test_vector_when_printed_has_no_spaces() -> None:
    assert format_vector((0.0395, 0.98541, 2.5156)) == "0.0395,0.9854,2.5156"
    assert format_vector((4.5, 1.9, 1.85), 2) == "4.50,1.90,1.85"


@pytest.mark.parametrize(
    ("values", "text"),
    # The first two are a configured position and its line in a capture of UDK.
    [((0.2085, -0.0, -0.2), "0.21,-0.00,-0.20"), ((0.145, 0.005, -3.14159), "0.14,0.00,-3.14")],
)
def test_rounded_vector_when_printed_equals_the_captures(
    values: tuple[float, ...], text: str
) -> None:
    assert format_rounded_vector(values) == text


def test_rounded_vector_when_not_finite_raises() -> None:
    with pytest.raises(LocalProtocolError, match="finite"):
        format_rounded_vector((0.0, math.inf))


def test_boolean_when_printed_is_capitalized() -> None:
    assert (format_boolean(True), format_boolean(False)) == ("True", "False")


NUMBERS = [
    ("1.5", 1.5),
    (".4", 0.4),
    ("-.4", -0.4),
    ("+2", 2.0),
    ("3.", 3.0),
    (" 7", 7.0),
    ("1e2", 100.0),
    ("1.5abc", 1.5),
    ("1,5", 1.0),
    ("abc", 0.0),
    ("", 0.0),
    (".", 0.0),
    ("-", 0.0),
    ("nan", 0.0),
    ("inf", 0.0),
    ("-infinity", 0.0),
    ("1e999", sys.float_info.max),
    ("-1e999", -sys.float_info.max),
    ("9" * 400, sys.float_info.max),
    ("9" * 60_000, sys.float_info.max),
    ("0x10", 0.0),
    ("1_000", 1.0),
    ("٣", 0.0),
]


@pytest.mark.parametrize(("text", "value"), NUMBERS)
def test_number_from_text_accepts_the_prefix_of_atof(text: str, value: float) -> None:
    assert number_from_text(text) == value


VECTORS = [
    ("4.5,1.9,1.8", (4.5, 1.9, 1.8)),
    (".4, .4, 1.8", (0.4, 0.4, 1.8)),
    ("1.5 1.0 0.2", (1.5, 1.0, 0.2)),
    ("  1   2  3 ", (1.0, 2.0, 3.0)),
    ("1 , 2 ,3", (1.0, 2.0, 3.0)),
    ("1,,3", (1.0, 0.0, 3.0)),
    ("1,2", (1.0, 2.0, 0.0)),
    ("1,2,3,4", (1.0, 2.0, 3.0)),
    ("", (0.0, 0.0, 0.0)),
    ("a,b,c", (0.0, 0.0, 0.0)),
]


@pytest.mark.parametrize(("text", "values"), VECTORS)
def test_vector_from_text_with_any_known_separator_has_three_numbers(
    text: str, values: tuple[float, float, float]
) -> None:
    assert vector_from_text(text) == values


@pytest.mark.parametrize("text", ["true", "True", "TRUE", "1", " true "])
def test_boolean_from_text_when_true_in_any_case_is_true(text: str) -> None:
    assert boolean_from_text(text) is True


@pytest.mark.parametrize("text", ["false", "False", "0", "", "maybe"])
def test_boolean_from_text_when_anything_else_is_false(text: str) -> None:
    assert boolean_from_text(text) is False


@DETERMINISTIC
@given(st.text())
def test_readers_of_any_text_return_finite_numbers(text: str) -> None:
    assert all(map(math.isfinite, (number_from_text(text), *vector_from_text(text))))
    assert boolean_from_text(text) in (True, False)


LISTS = [("", ()), ("  ", ()), ("1", (1.0,)), ("1,2, 3 4", (1.0, 2.0, 3.0, 4.0)), ("x", (0.0,))]


@pytest.mark.parametrize(("text", "numbers"), LISTS)
def test_numbers_from_text_has_any_count(text: str, numbers: tuple[float, ...]) -> None:
    assert numbers_from_text(text) == numbers


@pytest.mark.parametrize(
    ("text", "expected"),
    [("1.5", True), ("-.5", True), ("1.5m", False), ("", False), ("True", False), ("1e999", False)],
)
def test_is_number_requires_the_full_text(text: str, expected: bool) -> None:
    assert is_number(text) is expected


LONG_TEXTS = [
    65_000 * "1",
    65_000 * "1" + "x",
    "1." + 65_000 * "1" + "x",
    65_000 * " " + "x",
    "1e" + 65_000 * "9" + "x",
    32_000 * ". ",
    32_000 * ", ",
    32_000 * " ,",
    640 * ("a" + 100 * " "),
]
READERS = [number_from_text, is_number, vector_from_text, numbers_from_text, boolean_from_text]


@pytest.mark.parametrize("read", READERS, ids=lambda read: read.__name__)
@pytest.mark.parametrize("text", LONG_TEXTS, ids=lambda text: text[:4].replace(" ", "_"))
def test_reader_of_a_line_of_64_kb_takes_linear_time(
    read: Callable[[str], object], text: str
) -> None:
    started_s = time.process_time()
    read(text)
    # Linear: below 1 ms. A pattern with two ways to match took a minute.
    assert time.process_time() - started_s < 0.2
