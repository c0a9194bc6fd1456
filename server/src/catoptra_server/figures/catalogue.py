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

from catoptra_server.figures import style
from catoptra_server.figures.subject import Subject

Numbers = dict[str, float]


@dataclass(frozen=True, slots=True)
class Caption:
    """The words about a drawn figure. `alt` tells a reader without eyes what is in it."""

    title: str
    caption: str
    alt: str
    numbers: Numbers


@dataclass(frozen=True, slots=True)
class Figure:
    """A line of the table of figures. `figure`: which of the paper's it stands for, if any."""

    file: str
    figure: str
    width_px: int
    height_px: int
    draw: Callable[[style.Page, Subject], Caption]


def write_figure(figure: Figure, subject: Subject, folder: Path) -> Caption:
    """Draw a figure into a folder; return the words about it."""
    with style.page(figure.width_px, figure.height_px) as page:
        caption = figure.draw(page, subject)
        style.save(page, folder / figure.file)
    return caption


def write_captions(captions: Mapping[Figure, Caption], folder: Path) -> None:
    """Write figures.json."""
    entries = [
        {
            "file": figure.file,
            "figure": figure.figure,
            "title": caption.title,
            "caption": caption.caption,
            "alt": caption.alt,
        }
        for figure, caption in captions.items()
    ]
    numbers = {Path(figure.file).stem: caption.numbers for figure, caption in captions.items()}
    text = json.dumps({"figures": entries, "numbers": numbers}, indent=2, ensure_ascii=False)
    (folder / "figures.json").write_text(text + "\n", encoding="utf-8")
