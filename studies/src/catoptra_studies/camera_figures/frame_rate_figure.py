"""The paper's Figure 10: frames a second by payload, world and renderer."""

from __future__ import annotations

from collections.abc import Sequence

from catoptra_server.render.renderer_kind import RendererKind
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.figure_spec import FigureCaption, FigureInputs
from catoptra_studies.camera_figures.frame_rates import (
    PERSPECTIVE_VIEW,
    frame_time_spread,
    measure_frame_rates,
)
from catoptra_studies.camera_figures.render_timing import FrameRate
from catoptra_studies.paper_values import PAPER_POLYGON_COUNTS

FRAME_RATES_HEIGHT_PX = 690
_RENDERER_COLOURS = {"trace": plot_style.BLUE, "raster": plot_style.TEAL}


def draw_frame_rates(page: plot_style.Page, inputs: FigureInputs) -> FigureCaption:
    """Measure and draw the frame rates of all payloads in the subject's world, with trace."""
    rows = measure_frame_rates(
        inputs.subject,
        inputs.drive,
        RendererKind.TRACE,
        num_rounds=inputs.num_timed_frames,
        on_round=lambda: None,
    )
    draw_frame_rate_panels(page, rows)
    return _caption(rows, inputs.num_timed_frames)


def draw_frame_rate_panels(page: plot_style.Page, rows: Sequence[FrameRate]) -> None:
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


def _caption(rows: Sequence[FrameRate], num_frames: int) -> FigureCaption:
    spread = frame_time_spread(tuple(rows), min_polygons=PAPER_POLYGON_COUNTS[0])
    view = PERSPECTIVE_VIEW
    return FigureCaption(
        title="Frame rate by the payload of a robot",
        caption=(
            f"A perspective view of {view.width_px} × {view.height_px} pixels, as USARSim shows on "
            "its screen, rendered with nothing else, with the mirror camera through meshes or by "
            "the exact model (per pixel), or with a laser scanner LMS200. Medians of "
            f"{num_frames} frames on this machine, by the renderer trace on its processor. The "
            "paper found no influence of the number of polygons; here the slowest mesh takes "
            f"{100 * spread:.0f} % more processor time than the fastest. Other programs that "
            "ran at the same time lower the bars."
        ),
        alt="Bars of frames a second: highest without a camera, and similar for all meshes.",
        metrics={"width_px": view.width_px, "height_px": view.height_px, "frames": num_frames},
        timings={row.payload: round(row.fps, 1) for row in rows},
    )
