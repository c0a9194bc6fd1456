"""The paper's Figure 10: frames a second by what a robot carries, by world and renderer."""

from __future__ import annotations

from collections.abc import Sequence

from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.cost_results import FrameRate

WIDTH_PX, HEIGHT_PX = 1520, 690
_RENDERER_COLOURS = {"trace": plot_style.BLUE, "raster": plot_style.TEAL}


def draw(page: plot_style.Page, rows: Sequence[FrameRate]) -> None:
    """Draw a panel for each world, a pair of bars for each load."""
    worlds = list(dict.fromkeys(row.world for row in rows))
    highest = max(row.fps for row in rows)
    width = (1400 - 60 * (len(worlds) - 1)) // len(worlds)
    for index, world in enumerate(worlds):
        on = plot_style.add_axes(page, 90 + index * (width + 60), 120, width, 440)
        _draw_panel(on, [row for row in rows if row.world == world], world)
        on.set_ylim(0.0, 1.12 * highest)
        on.tick_params(labelleft=index == 0)
    handles, labels = on.get_legend_handles_labels()
    page.legend(handles, labels, loc="upper right", ncols=2)


def _draw_panel(axes: plot_style.Axes, rows: Sequence[FrameRate], world: str) -> None:
    loads = list(dict.fromkeys(row.payload for row in rows))
    renderers = list(dict.fromkeys(row.renderer for row in rows))
    width = 0.8 / len(renderers)
    for index, renderer in enumerate(renderers):
        of_one = [row for row in rows if row.renderer == renderer]
        places = [loads.index(row.payload) + (index + 0.5) * width - 0.4 for row in of_one]
        bars = axes.bar(
            places, [row.fps for row in of_one], 0.94 * width, color=_RENDERER_COLOURS[renderer],
            label=renderer,
        )  # fmt: skip
        axes.bar_label(bars, fmt="%.0f", fontsize=6, padding=1.5, color=plot_style.MUTED)
    axes.set_title(f"frames a second in {world}", loc="left", fontsize=8.5)
    axes.set_xticks(range(len(loads)), [_tick_label(load) for load in loads], fontsize=7)
    axes.grid(visible=False, axis="x")
    numbered = [place for place, load in enumerate(loads) if load.isdigit()]
    axes.set_xlabel("polygons of the camera's mirror", fontsize=7.5, labelpad=2,
                  x=(sum(numbered) / len(numbered) + 0.5) / len(loads))  # fmt: skip


def _tick_label(payload: str) -> str:
    """Return a load in two short lines."""
    return payload.replace(" ", "\n")
