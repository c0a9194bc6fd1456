"""Markdown tables and paragraphs, aligned in their source so that they read well unrendered."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

# As wide as the sources, so that a diff of a report shows changed sentences, not paragraphs.
_LINE_WIDTH = 100


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table: the first column is text, all others are numbers aligned right."""
    cells = [[_escape_cell(cell) for cell in row] for row in (header, *rows)]
    # Three dashes are the shortest rule that Markdown accepts.
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
    """Format a number with as many significant digits, without an exponent where short enough."""
    if math.isinf(value) or math.isnan(value):
        return "-" if math.isnan(value) else "inf"
    if value == 0.0:
        return "0"
    # Decimals that leave `digits` significant ones; negative powers of ten need more.
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits - 1}e}" if decimals > 5 else f"{value:.{decimals}f}"


def wrap_paragraph(text: str) -> str:
    """Wrap a text at the width of the sources."""
    return textwrap.fill(" ".join(text.split()), _LINE_WIDTH, break_on_hyphens=False)


def wrap_bullet(text: str) -> str:
    """Wrap an entry of a list."""
    return textwrap.fill(
        " ".join(text.split()),
        _LINE_WIDTH,
        initial_indent="* ",
        subsequent_indent="  ",
        break_on_hyphens=False,
    )
