"""Time against error: the proved bound on the left, the image error on the right, with fronts."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.cost_results import LevelCost
from catoptra_studies.accuracy_cost.pareto import MIN_GAIN, pareto_front
from catoptra_studies.accuracy_cost.plots.plot_legend import SERIES_STYLES, series_style
from catoptra_studies.reports import format_number

PARETO_HEIGHT_PX = 1150
_TOP_PX, _PANEL_WIDTH_PX, _PANEL_HEIGHT_PX = 90, 600, 560
_TICKS_MS = (2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 150, 200, 300, 500)

ErrorMetric = Callable[[LevelCost], float]


def draw_pareto(page: plot_style.Page, levels: Sequence[LevelCost]) -> None:
    """Draw both panels, a legend, and the names of the numbered levels."""
    _, bound_front = _draw_panel(
        page, levels, lambda level: level.bound_max_px, left=110,
        title="geometry: limit of the displacement, px",
    )  # fmt: skip
    axes, image_front = _draw_panel(
        page, levels, lambda level: level.rmse, left=860,
        title="image: RMSE against the reference, grey levels",
    )  # fmt: skip
    _list_front_levels(
        page, bound_front, lambda level: f"{format_number(level.bound_max_px, 2)} px", left=40
    )
    _list_front_levels(
        page, image_front, lambda level: f"RMSE {format_number(level.rmse, 2)}", left=790
    )
    handles, labels = axes.get_legend_handles_labels()
    page.legend(
        handles, labels, loc="upper center", ncols=4, fontsize=6.5, handletextpad=0.1,
        columnspacing=1.0,
    )  # fmt: skip


def _draw_panel(
    page: plot_style.Page, levels: Sequence[LevelCost], error: ErrorMetric, *, left: int, title: str
) -> tuple[plot_style.Axes, list[LevelCost]]:
    """Draw all levels as points and their front as stairs; return the axes and the front."""
    axes = plot_style.add_axes(page, left, _TOP_PX + 30, _PANEL_WIDTH_PX, _PANEL_HEIGHT_PX)
    axes.set(xscale="log", yscale="log", xlabel="a frame, ms")
    axes.set_title(title, loc="left", fontsize=8)
    for style in SERIES_STYLES:
        series = [level for level in levels if series_style(level) is style]
        axes.plot(
            [level.wall_ms for level in series], [error(level) for level in series], style.marker,
            color=style.colour, markersize=4, alpha=0.75, label=style.name,
        )  # fmt: skip
    # Each panel has a front of its own: a level can be best in geometry and beaten as an image.
    front = _pareto_levels(levels, error)
    _label_polygon_counts(axes, levels, error)
    _draw_front(axes, front, error)
    _set_time_ticks(axes, [level.wall_ms for level in levels])
    return axes, front


def _pareto_levels(levels: Sequence[LevelCost], error: ErrorMetric) -> list[LevelCost]:
    points = [(level.wall_ms, error(level)) for level in levels]
    return [levels[index] for index in pareto_front(points, min_gain=MIN_GAIN)]


def _draw_front(axes: plot_style.Axes, front: Sequence[LevelCost], error: ErrorMetric) -> None:
    """Draw the front and number its levels."""
    x, y = [level.wall_ms for level in front], [error(level) for level in front]
    axes.plot(x, y, drawstyle="steps-post", color=plot_style.FOREGROUND, linewidth=0.9, zorder=1)
    axes.set_ylim(bottom=0.45 * min(y))
    circle = {
        "boxstyle": "circle,pad=0.18", "facecolor": plot_style.FOREGROUND, "edgecolor": "none",
    }  # fmt: skip
    for number, point in enumerate(zip(x, y, strict=True), 1):
        axes.annotate(
            str(number), point, (0, -9), textcoords="offset points", fontsize=7, ha="center",
            va="center", color=plot_style.BACKGROUND, fontweight="bold", zorder=5, bbox=circle,
        )  # fmt: skip


def _label_polygon_counts(
    axes: plot_style.Axes, levels: Sequence[LevelCost], error: ErrorMetric
) -> None:
    """Write the number of polygons beside each of the paper's meshes."""
    for level in levels:
        if level.num_polygons and level.is_key:
            axes.annotate(
                str(level.num_polygons), (level.wall_ms, error(level)), (5, 3),
                textcoords="offset points", fontsize=7, color=plot_style.ORANGE,
            )  # fmt: skip


def _set_time_ticks(axes: plot_style.Axes, times_ms: Sequence[float]) -> None:
    # Matplotlib labels decades only, and a study spans little more than one.
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
    title = "never beaten in time and this error at once"
    plot_style.add_text(page, left, top, title, fontweight="bold", fontsize=7.5)
    for number, level in enumerate(front, 1):
        text = f"{number}  {level.name}: {level.wall_ms:.1f} ms, {format_error(level)}"
        plot_style.add_text(page, left, top + 30 * number, text, fontsize=7)
