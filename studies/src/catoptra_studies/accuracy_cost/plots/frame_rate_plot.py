"""The paper's Figure 10: frames a second by payload, world and renderer."""

from __future__ import annotations

from collections.abc import Sequence

from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.cost_results import FrameRate

WIDTH_PX, HEIGHT_PX = 1520, 690
_RENDERER_COLOURS = {"trace": plot_style.BLUE, "raster": plot_style.TEAL}


def draw(page: plot_style.Page, rows: Sequence[FrameRate]) -> None:
    """Draw a panel for each world, with one bar for each payload and renderer."""
    worlds = list(dict.fromkeys(row.world for row in rows))
    max_fps = max(row.fps for row in rows)
    width = (1400 - 60 * (len(worlds) - 1)) // len(worlds)
    for index, world in enumerate(worlds):
        axes = plot_style.add_axes(page, 90 + index * (width + 60), 120, width, 440)
        _draw_panel(axes, [row for row in rows if row.world == world], world)
        # One scale for all worlds; only the first panel has numbers on it.
        axes.set_ylim(0.0, 1.12 * max_fps)
        axes.tick_params(labelleft=index == 0)
    handles, labels = axes.get_legend_handles_labels()
    page.legend(handles, labels, loc="upper right", ncols=2)


def _draw_panel(axes: plot_style.Axes, rows: Sequence[FrameRate], world: str) -> None:
    payloads = list(dict.fromkeys(row.payload for row in rows))
    renderers = list(dict.fromkeys(row.renderer for row in rows))
    width = 0.8 / len(renderers)
    for index, renderer in enumerate(renderers):
        bars = [row for row in rows if row.renderer == renderer]
        centres = [payloads.index(row.payload) + (index + 0.5) * width - 0.4 for row in bars]
        artists = axes.bar(
            centres, [row.fps for row in bars], 0.94 * width, color=_RENDERER_COLOURS[renderer],
            label=renderer,
        )  # fmt: skip
        axes.bar_label(artists, fmt="%.0f", fontsize=6, padding=1.5, color=plot_style.MUTED)
    axes.set_title(f"frames a second in {world}", loc="left", fontsize=8.5)
    axes.set_xticks(range(len(payloads)), [_tick_label(name) for name in payloads], fontsize=7)
    axes.grid(visible=False, axis="x")
    # The label is centred under the payloads that are numbers of polygons.
    numbers = [position for position, payload in enumerate(payloads) if payload.isdigit()]
    centre = (sum(numbers) / len(numbers) + 0.5) / len(payloads)
    axes.set_xlabel("polygons of the camera's mirror", fontsize=7.5, labelpad=2, x=centre)


def _tick_label(payload: str) -> str:
    """The payload in two short lines."""
    return payload.replace(" ", "\n")
