from __future__ import annotations

import math

import pytest

from catoptra_studies.reports import (
    format_number,
    markdown_table,
    wrap_bullet,
    wrap_paragraph,
)


def test_table_is_aligned_with_text_left_and_numbers_right() -> None:
    table = markdown_table(("level", "ms"), [("trace", "12.5"), ("a|b", "3")])
    assert table.split("\n") == [
        "| level |   ms |",
        "| ----- | ---: |",
        "| trace | 12.5 |",
        "| a\\|b  |    3 |",
    ]


@pytest.mark.parametrize(
    ("value", "digits", "expected"),
    [
        (0.0, 3, "0"),
        (95.44, 3, "95.4"),
        (1234.5, 2, "1234"),
        (0.0603, 3, "0.0603"),
        (3.77e-5, 3, "3.77e-05"),
        (math.inf, 3, "inf"),
        (math.nan, 3, "-"),
    ],
)
def test_number_has_its_significant_digits(value: float, digits: int, expected: str) -> None:
    assert format_number(value, digits) == expected


def test_paragraph_is_wrapped_and_a_bullet_hangs() -> None:
    text = "word " * 40
    assert max(map(len, wrap_paragraph(text).split("\n"))) <= 100
    first, second, *_ = wrap_bullet(text).split("\n")
    assert first.startswith("* word")
    assert second.startswith("  word")
