"""What the pictures have in common: how families of steps look, and a scale of errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from catoptra_server.cost.document import StepCost
from catoptra_server.cost.error_map import scale_bar
from catoptra_server.figures import style


@dataclass(frozen=True, slots=True)
class Look:
    """How the points of a family are drawn."""

    name: str
    colour: str
    marker: str


TRACE = Look("trace, exact law in every ray", style.BLUE, "D")
PER_PIXEL = Look("raster, exact law in every pixel", style.TEAL, "o")
UV = Look("raster, polygons, UV as in the paper", style.ORANGE, "s")
POSITION = Look("raster, polygons, position", style.RED, "^")
LOOKS = (TRACE, PER_PIXEL, UV, POSITION)


def look_of(step: StepCost) -> Look:
    """Return how a step is drawn."""
    if step.renderer == "trace":
        return TRACE
    if not step.polygons:
        return PER_PIXEL
    return UV if "(uv)" in step.name else POSITION


def draw_scale(
    page: style.Page,
    ends: tuple[float, float],
    *,
    left: int,
    top: int,
    width: int,
    marks: Sequence[float],
    title: str,
) -> None:
    """Draw the scale of `error_colours` between two ends, with marks below and its title beside."""
    least, largest = ends
    bar = style.picture(page, scale_bar(width, 22, least, largest), left, top, width)
    bar.axis("on")
    bar.set_yticks([])
    bar.grid(visible=False)
    bar.set_xticks([_along(mark, ends, width) for mark in marks], [f"{mark:g}" for mark in marks])
    style.words(page, left - 14, top + 11, title, ha="right", va="center")


def framed(on: style.Axes) -> None:
    """Draw a thin frame round a picture whose own ground is white."""
    on.axis("on")
    on.set(xticks=[], yticks=[])
    on.spines[:].set(visible=True, color=style.FAINT)


def _along(value: float, ends: tuple[float, float], width: int) -> float:
    least, largest = ends
    return width * math.log(value / least) / math.log(largest / least)
