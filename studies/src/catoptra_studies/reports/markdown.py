"""Tables in Markdown, aligned in their source, so that they read well without being rendered."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

# Columns of the report's prose, so that its changes can be read line by line.
_LINE_WIDTH = 100


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table; the first column is words, all others are numbers and stand right."""
    cells = [[_escape_cell(cell) for cell in row] for row in (header, *rows)]
    widths = [max(3, *(len(row[column]) for row in cells)) for column in range(len(header))]
    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    first, *others = cells
    return "\n".join(_table_line(row, widths) for row in (first, rule, *others))


def _table_line(cells: Sequence[str], widths: Sequence[int]) -> str:
    first, *others = zip(cells, widths, strict=True)
    padded = [first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in others)]
    return f"| {' | '.join(padded)} |"


def _escape_cell(cell: str) -> str:
    return cell.replace("|", "\\|")


def format_number(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, without an exponent where it is short."""
    if math.isinf(value) or math.isnan(value):
        return "-" if math.isnan(value) else "inf"
    if value == 0.0:
        return "0"
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits - 1}e}" if decimals > 5 else f"{value:.{decimals}f}"


def wrap_paragraph(text: str) -> str:
    """Return a text wrapped as the sources are."""
    return textwrap.fill(" ".join(text.split()), _LINE_WIDTH, break_on_hyphens=False)


def wrap_bullet(text: str) -> str:
    """Return a wrapped line of a list."""
    return textwrap.fill(
        " ".join(text.split()),
        _LINE_WIDTH,
        initial_indent="* ",
        subsequent_indent="  ",
        break_on_hyphens=False,
    )
