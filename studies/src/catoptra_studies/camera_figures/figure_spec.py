"""What a figure is: a page, a way to draw it, and words about it; and how all of them are told.

`figures.json` holds `figures`, a list of file, figure (of the paper), title, caption, alt; and
`numbers`, by file name without its ending: every number that a caption states, so that no reader
has to parse a sentence.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_subject import FigureSubject

Metrics = dict[str, float]


@dataclass(frozen=True, slots=True)
class FigureCaption:
    """The words about a drawn figure. `alt` tells a reader without eyes what is in it."""

    title: str
    caption: str
    alt: str
    metrics: Metrics


@dataclass(frozen=True, slots=True)
class FigureSpec:
    """A line of the table of figures. `figure`: which of the paper's it stands for, if any."""

    file: str
    paper_reference: str
    width_px: int
    height_px: int
    draw: Callable[[plot_style.Page, FigureSubject], FigureCaption]


def write_figure(figure: FigureSpec, subject: FigureSubject, folder: Path) -> FigureCaption:
    """Draw a figure into a folder; return the words about it."""
    with plot_style.open_page(figure.width_px, figure.height_px) as page:
        caption = figure.draw(page, subject)
        plot_style.save_page(page, folder / figure.file)
    return caption


def write_figure_index(captions: Mapping[FigureSpec, FigureCaption], folder: Path) -> None:
    """Write figures.json."""
    entries = [
        {
            "file": figure.file,
            "figure": figure.paper_reference,
            "title": caption.title,
            "caption": caption.caption,
            "alt": caption.alt,
        }
        for figure, caption in captions.items()
    ]
    numbers = {Path(figure.file).stem: caption.metrics for figure, caption in captions.items()}
    text = json.dumps({"figures": entries, "numbers": numbers}, indent=2, ensure_ascii=False)
    (folder / "figures.json").write_text(text + "\n", encoding="utf-8")
