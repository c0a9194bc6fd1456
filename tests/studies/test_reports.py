from __future__ import annotations

import math
from pathlib import Path

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_studies.reports import (
    Cell,
    format_number,
    html_table,
    markdown_table,
    replace_block,
    wrap_paragraph,
)


def test_table_has_a_heading_row_and_escapes_its_cells() -> None:
    table = html_table(["a", Cell("b", "n")], [["1 < 2", Cell("3", "n")]])
    assert table == (
        '<table><tr><th>a</th><th class="n">b</th></tr>'
        '<tr><td>1 &lt; 2</td><td class="n">3</td></tr></table>'
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
    first, second, *_ = wrap_paragraph(text, bullet="* ").split("\n")
    assert first.startswith("* word")
    assert second.startswith("  word")


TEXT = "before\n<!-- cost: begin, written by make cost -->\nold\n<!-- cost: end -->\nafter\n"


def test_block_is_replaced_and_the_rest_stays_however_often(tmp_path: Path) -> None:
    path = tmp_path / "README.md"
    path.write_text(TEXT)
    for _ in range(2):
        replace_block(path, "cost", "new\ntable")
        assert path.read_text() == TEXT.replace("old", "new\ntable")


@pytest.mark.parametrize("missing", ["<!-- cost: begin", "<!-- cost: end -->"])
def test_file_when_a_mark_is_missing_is_rejected_and_unchanged(
    tmp_path: Path, missing: str
) -> None:
    path = tmp_path / "README.md"
    path.write_text(TEXT.replace(missing, ""))
    before = path.read_text()
    with pytest.raises(CatoptraError, match="no marks for the table"):
        replace_block(path, "cost", "new")
    assert path.read_text() == before
