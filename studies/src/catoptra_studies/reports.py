"""Parts of the studies' reports: an HTML page of one file, Markdown, JSON and marked blocks.

Texts are escaped and figures embedded here, so that no study has to remember. Markdown is aligned
in the source and reads well unrendered. A marked block is a generated part of a hand-written file.
"""

from __future__ import annotations

import base64
import html
import json
import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from catoptra_protocol.errors import CatoptraError


@dataclass(frozen=True, slots=True)
class ReportFigure:
    """A PNG file with texts."""

    file: str
    title: str
    caption: str

    alt: str
    """Description for readers who cannot see the figure."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell of a table with a style, as plain text."""

    text: str

    css_class: str
    """Class of the report's style sheet: n aligns right, yes and no have colours."""


# CSS pixels of a pixel of a figure: text of 24 px is then as large as the report's.
_DISPLAY_SCALE = 0.625


def figure_element(folder: Path, figure: ReportFigure) -> str:
    """Figure with the image inside, so that the report remains one file."""
    png = (folder / figure.file).read_bytes()
    # The header of a PNG file has the width in the bytes 16 to 19.
    width_px = round(_DISPLAY_SCALE * int.from_bytes(png[16:20], "big"))
    # A third larger than the file, but a report of one file can be mailed and archived.
    data = base64.b64encode(png).decode()
    return (
        f'<figure><img width="{width_px}" alt="{html.escape(figure.alt)}" '
        f'src="data:image/png;base64,{data}">'
        f"<figcaption><strong>{html.escape(figure.title)}.</strong> "
        f"{html.escape(figure.caption)}</figcaption></figure>"
    )


def figure_elements(folder: Path, figures: Sequence[ReportFigure]) -> str:
    """Several figures below each other."""
    return "\n".join(figure_element(folder, figure) for figure in figures)


def html_table(header: Sequence[Cell | str], rows: Sequence[Sequence[Cell | str]]) -> str:
    """Table with a row of headings; cells without a style are plain texts."""
    lines = [_row_element("th", header), *(_row_element("td", row) for row in rows)]
    return f"<table>{''.join(lines)}</table>"


def _row_element(tag: str, cells: Sequence[Cell | str]) -> str:
    return f"<tr>{''.join(_cell_element(tag, cell) for cell in cells)}</tr>"


def _cell_element(tag: str, cell: Cell | str) -> str:
    # Every text is escaped here, so that no caller has to remember.
    if isinstance(cell, str):
        return f"<{tag}>{html.escape(cell)}</{tag}>"
    return f'<{tag} class="{cell.css_class}">{html.escape(cell.text)}</{tag}>'


# As wide as the sources, so that a diff of a report shows changed sentences, not paragraphs.
_LINE_WIDTH = 100


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table: the first column is text, all others are numbers aligned right."""
    cells = [[cell.replace("|", "\\|") for cell in row] for row in (header, *rows)]
    # Three dashes are the shortest rule that Markdown accepts.
    widths = [max(3, *(len(row[column]) for row in cells)) for column in range(len(header))]
    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    first, *others = cells
    return "\n".join(_table_line(row, widths) for row in (first, rule, *others))


def _table_line(cells: Sequence[str], widths: Sequence[int]) -> str:
    first, *others = zip(cells, widths, strict=True)
    padded = [first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in others)]
    return f"| {' | '.join(padded)} |"


def format_number(value: float, digits: int = 3) -> str:
    """Format a number with as many significant digits, without an exponent where short enough."""
    if math.isinf(value) or math.isnan(value):
        return "-" if math.isnan(value) else "inf"
    if value == 0.0:
        return "0"
    # Decimals that leave `digits` significant ones; negative powers of ten need more.
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{digits - 1}e}" if decimals > 5 else f"{value:.{decimals}f}"


def wrap_paragraph(text: str, *, bullet: str = "") -> str:
    """Wrap a text, or an entry of a list behind its bullet, at the width of the sources."""
    return textwrap.fill(
        " ".join(text.split()),
        _LINE_WIDTH,
        initial_indent=bullet,
        subsequent_indent=" " * len(bullet),
        break_on_hyphens=False,
    )


def write_json(path: Path, content: object, *, ensure_ascii: bool = True) -> None:
    """Write numbers for programs: indented JSON without NaN, which readers reject."""
    text = json.dumps(content, indent=2, allow_nan=False, ensure_ascii=ensure_ascii)
    path.write_text(text + "\n", encoding="utf-8")


def replace_non_finite(value: Any) -> Any:
    """None for inf and nan, within maps and lists, too: no JSON reader but Python's knows these."""
    if isinstance(value, dict):
        return {key: replace_non_finite(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [replace_non_finite(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def replace_block(path: Path, name: str, text: str) -> None:
    """Replace the text between `<!-- name: begin ... -->` and `<!-- name: end -->`.

    Raises:
        CatoptraError: The file has no such marks.
    """
    before, begin, rest = path.read_text(encoding="utf-8").partition(f"<!-- {name}: begin")
    # The opening mark may go on with a note for editors, which stays.
    note, close, after_note = rest.partition("-->\n")
    _, end, after = after_note.partition(f"<!-- {name}: end -->")
    if not (begin and close and end):
        raise CatoptraError(
            f"{path}: no marks for the table: put the lines <!-- {name}: begin --> and "
            f"<!-- {name}: end --> where the table is to be"
        )
    path.write_text(f"{before}{begin}{note}{close}{text}\n{end}{after}", encoding="utf-8")
