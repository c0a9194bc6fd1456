"""Time against error: the bound on the left, what is seen on the right, and the front of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.cost_results import LevelCost
from catoptra_studies.reports.markdown import format_number
from catoptra_studies.accuracy_cost.pareto import MIN_GAIN, pareto_front
from catoptra_studies.accuracy_cost.plots.plot_legend import SERIES_STYLES, series_style

WIDTH_PX, HEIGHT_PX = 1520, 1150
_TOP_PX, _PANEL_WIDTH_PX, _PANEL_HEIGHT_PX = 90, 600, 560
_TICKS_MS = (2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 150, 200, 300, 500)

ErrorMetric = Callable[[LevelCost], float]


def draw(page: plot_style.Page, levels: Sequence[LevelCost]) -> None:
    """Draw both panels, a legend, and the names of the numbered steps."""
    bound = _draw_panel(
        page, levels, lambda step: step.bound_max_px, left=110,
        title="geometry: no place is farther off, px",
    )  # fmt: skip
    seen = _draw_panel(
        page, levels, lambda step: step.rmse, left=860,
        title="picture: RMSE against the reference, grey levels",
    )  # fmt: skip
    _list_front_levels(
        page, bound[1], lambda step: f"{format_number(step.bound_max_px, 2)} px", left=40
    )
    _list_front_levels(page, seen[1], lambda step: f"RMSE {format_number(step.rmse, 2)}", left=790)
    handles, labels = seen[0].get_legend_handles_labels()
    page.legend(
        handles, labels, loc="upper center", ncols=4, fontsize=6.5, handletextpad=0.1,
        columnspacing=1.0,
    )  # fmt: skip


def _draw_panel(
    page: plot_style.Page, levels: Sequence[LevelCost], error: ErrorMetric, *, left: int, title: str
) -> tuple[plot_style.Axes, list[LevelCost]]:
    """Draw the points of all steps, their front as stairs; return the axes and the front."""
    on = plot_style.add_axes(page, left, _TOP_PX + 30, _PANEL_WIDTH_PX, _PANEL_HEIGHT_PX)
    on.set(xscale="log", yscale="log", xlabel="a frame, ms")
    on.set_title(title, loc="left", fontsize=8)
    for look in SERIES_STYLES:
        of_look = [step for step in levels if series_style(step) is look]
        on.plot(
            [step.wall_ms for step in of_look], [error(step) for step in of_look], look.marker,
            color=look.colour, markersize=4, alpha=0.75, label=look.name,
        )  # fmt: skip
    front = _pareto_levels(levels, error)
    _label_polygon_counts(on, levels, error)
    _draw_front(on, front, error)
    _set_time_ticks(on, [step.wall_ms for step in levels])
    return on, front


def _pareto_levels(levels: Sequence[LevelCost], error: ErrorMetric) -> list[LevelCost]:
    points = [(step.wall_ms, error(step)) for step in levels]
    return [levels[index] for index in pareto_front(points, min_gain=MIN_GAIN)]


def _draw_front(axes: plot_style.Axes, front: Sequence[LevelCost], error: ErrorMetric) -> None:
    """Draw the front and number it."""
    x, y = [step.wall_ms for step in front], [error(step) for step in front]
    axes.plot(x, y, drawstyle="steps-post", color=plot_style.FOREGROUND, linewidth=0.9, zorder=1)
    axes.set_ylim(bottom=0.45 * min(y))
    for row, place in enumerate(zip(x, y, strict=True), 1):
        axes.annotate(
            str(row), place, (0, -9), textcoords="offset points", fontsize=7, ha="center",
            va="center", color=plot_style.BACKGROUND, fontweight="bold", zorder=5,
            bbox={"boxstyle": "circle,pad=0.18", "facecolor": plot_style.FOREGROUND, "edgecolor": "none"},
        )  # fmt: skip


def _label_polygon_counts(
    axes: plot_style.Axes, levels: Sequence[LevelCost], error: ErrorMetric
) -> None:
    """Write its number of polygons beside each of the paper's meshes."""
    for step in levels:
        if step.num_polygons and step.is_key:
            axes.annotate(
                str(step.num_polygons), (step.wall_ms, error(step)), (5, 3), textcoords="offset points",
                fontsize=7, color=plot_style.ORANGE,
            )  # fmt: skip


def _set_time_ticks(axes: plot_style.Axes, times_ms: Sequence[float]) -> None:
    low, high = 0.85 * min(times_ms), 1.2 * max(times_ms)
    ticks = [tick for tick in _TICKS_MS if low <= tick <= high]
    axes.set_xlim(low, high)
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()


def _list_front_levels(
    page: plot_style.Page,
    front: Sequence[LevelCost],
    format_error: Callable[[LevelCost], str],
    *,
    left: int,
) -> None:
    top = _TOP_PX + _PANEL_HEIGHT_PX + 130
    plot_style.add_text(page, left, top, "never beaten in time and this error at once", fontweight="bold",
                fontsize=7.5)  # fmt: skip
    for row, step in enumerate(front, 1):
        text = f"{row}  {step.name}: {step.wall_ms:.1f} ms, {format_error(step)}"
        plot_style.add_text(page, left, top + 30 * row, text, fontsize=7)
