"""Elements of an HTML report in one file: embedded figures and tables, escaped."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class ReportFigure:
    """A PNG file with its texts."""

    file: str
    title: str
    caption: str

    alt: str
    """Description for readers who cannot see the figure."""


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell of a table, as plain text."""

    text: str

    css_class: str = ""
    """Class of the report's style sheet: n aligns right, yes and no have colours."""


# CSS pixels of a pixel of a figure: its text of 24 px is then as large as that of a report.
_DISPLAY_SCALE = 0.625


def figure_element(folder: Path, figure: ReportFigure) -> str:
    """Figure with its image inside, so that the report remains one file."""
    png = (folder / figure.file).read_bytes()
    # The header of a PNG file has its width in the bytes 16 to 19.
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


def html_table(header: Sequence[Cell], rows: Sequence[Sequence[Cell]]) -> str:
    """Table with a row of headings."""
    lines = [_row_element("th", header), *(_row_element("td", row) for row in rows)]
    return f"<table>{''.join(lines)}</table>"


def _row_element(tag: str, cells: Sequence[Cell]) -> str:
    return f"<tr>{''.join(_cell_element(tag, cell) for cell in cells)}</tr>"


def _cell_element(tag: str, cell: Cell) -> str:
    # Every text is escaped here, so that no caller has to remember.
    attribute = f' class="{cell.css_class}"' if cell.css_class else ""
    return f"<{tag}{attribute}>{html.escape(cell.text)}</{tag}>"
