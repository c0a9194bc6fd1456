"""Literals of numbers, and their ranges in words."""

from __future__ import annotations

import math

import pytest

from catoptra_server.config.section_reader import describe_range, parse_number


@pytest.mark.parametrize(
    ("text", "value"), [("1", 1.0), ("-.4", -0.4), ("1e3", 1000.0), ("2.5f", 2.5)]
)
def test_number_when_written_as_in_real_files_is_read(text: str, value: float) -> None:
    assert parse_number(text) == value


@pytest.mark.parametrize("text", ["", "abc", "nan", "inf", "-inf", "+inf", "1e999", "1,5", "f"])
def test_number_when_malformed_or_not_finite_is_none(text: str) -> None:
    assert parse_number(text) is None


@pytest.mark.parametrize(
    ("bounds", "text"),
    [
        ((-math.inf, math.inf), "a number"),
        ((0.0, math.inf), "a number of at least 0"),
        ((0.0, 2**31), "a number of at least 0"),
        ((-math.inf, 1.0), "a number of at most 1"),
        ((0.5, 10.0), "a number from 0.5 to 10"),
    ],
)
def test_range_when_described_names_its_bounds(bounds: tuple[float, float], text: str) -> None:
    assert describe_range("a number", *bounds) == text
