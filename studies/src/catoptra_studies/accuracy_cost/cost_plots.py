"""Plots of the study's numbers: time against error, frame rates, localization.

Time against error has two panels with a front each: the proved bound and the error of the image.
Localization has rates and errors with the frames of each key level, from coarse to exact.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from catoptra_studies.accuracy_cost.cost_results import (
    MIN_GAIN,
    CostResults,
    LevelCost,
    LocalizationAccuracy,
    LocalizationRow,
    pareto_front,
)
from catoptra_studies.camera_figures.frame_rates import draw_frame_rate_panels
from catoptra_studies.plot_style import (
    BACKGROUND,
    BLUE,
    FOREGROUND,
    MUTED,
    ORANGE,
    RED,
    TEAL,
    Axes,
    Page,
    add_axes,
    add_legend,
    add_text,
    open_page,
)
from catoptra_studies.reports import format_number


def write_result_plots(results: CostResults, folder: Path) -> None:
    """Write pareto.png, and frame_rates.png and localization.png where these were measured."""
    with open_page(folder / "pareto.png", 1150) as page:
        _draw_pareto(page, results.levels)
    if results.frame_rates:
        with open_page(folder / "frame_rates.png", 690) as page:
            draw_frame_rate_panels(page, results.frame_rates)
    if results.localization:
        with open_page(folder / "localization.png", 620) as page:
            _draw_localization(page, results.localization)


# Name, colour and Matplotlib's marker of each kind of level. Markers differ as well as colours, for
# readers who confuse two of these.
_TRACE, _PER_PIXEL, _UV, _POSITION = _SERIES = (
    ("trace, camera model in every ray", BLUE, "D"),
    ("raster, camera model in every pixel", TEAL, "o"),
    ("raster, polygons, UV as in the paper", ORANGE, "s"),
    ("raster, polygons, position", RED, "^"),
)


def _series_of_level(level: LevelCost) -> tuple[str, str, str]:
    if level.renderer == "trace":
        return _TRACE
    if not level.num_polygons:
        return _PER_PIXEL
    # By the name: cost.json can be plotted without the server's types.
    return _UV if "(uv)" in level.name else _POSITION


_TOP_PX, _ERROR_PANEL_WIDTH_PX, _PANEL_HEIGHT_PX = 90, 600, 560
_TICKS_MS = (2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 150, 200, 300, 500)

_ErrorMetric = Callable[[LevelCost], float]


def _draw_pareto(page: Page, levels: Sequence[LevelCost]) -> None:
    """Draw both panels, a legend, and the names of the numbered levels."""
    _, bound_front = _draw_error_panel(
        page, levels, lambda level: level.bound_max_px, left=110,
        title="geometry: limit of the displacement, px",
    )  # fmt: skip
    axes, image_front = _draw_error_panel(
        page, levels, lambda level: level.rmse, left=860,
        title="image: RMSE against the reference, grey levels",
    )  # fmt: skip
    _list_front_levels(
        page, bound_front, lambda level: f"{format_number(level.bound_max_px, 2)} px", left=40
    )
    _list_front_levels(
        page, image_front, lambda level: f"RMSE {format_number(level.rmse, 2)}", left=790
    )
    add_legend(
        page, axes, loc="upper center", ncols=4, fontsize=6.5, handletextpad=0.1, columnspacing=1.0
    )


def _draw_error_panel(
    page: Page, levels: Sequence[LevelCost], error: _ErrorMetric, *, left: int, title: str
) -> tuple[Axes, list[LevelCost]]:
    """Draw all levels as points and their front as stairs; return the axes and the front."""
    axes = add_axes(page, left, _TOP_PX + 30, _ERROR_PANEL_WIDTH_PX, _PANEL_HEIGHT_PX)
    axes.set(xscale="log", yscale="log", xlabel="a frame, ms")
    axes.set_title(title, loc="left", fontsize=8)
    for series in _SERIES:
        name, colour, marker = series
        own = [level for level in levels if _series_of_level(level) == series]
        axes.plot(
            [level.wall_ms for level in own], [error(level) for level in own], marker,
            color=colour, markersize=4, alpha=0.75, label=name,
        )  # fmt: skip
    # One front for each panel: a level can be best in geometry and beaten as an image.
    points = [(level.wall_ms, error(level)) for level in levels]
    front = [levels[index] for index in pareto_front(points, min_gain=MIN_GAIN)]
    _label_polygon_counts(axes, levels, error)
    _draw_front(axes, front, error)
    _set_time_ticks(axes, [level.wall_ms for level in levels])
    return axes, front


def _draw_front(axes: Axes, front: Sequence[LevelCost], error: _ErrorMetric) -> None:
    """Draw the front with a number at each level."""
    x, y = [level.wall_ms for level in front], [error(level) for level in front]
    axes.plot(x, y, drawstyle="steps-post", color=FOREGROUND, linewidth=0.9, zorder=1)
    axes.set_ylim(bottom=0.45 * min(y))
    circle = {
        "boxstyle": "circle,pad=0.18", "facecolor": FOREGROUND, "edgecolor": "none",
    }  # fmt: skip
    for number, point in enumerate(zip(x, y, strict=True), 1):
        axes.annotate(
            str(number), point, (0, -9), textcoords="offset points", fontsize=7, ha="center",
            va="center", color=BACKGROUND, fontweight="bold", zorder=5, bbox=circle,
        )  # fmt: skip


def _label_polygon_counts(axes: Axes, levels: Sequence[LevelCost], error: _ErrorMetric) -> None:
    """Write the number of polygons next to each of the paper's meshes."""
    for level in levels:
        if level.num_polygons and level.is_key:
            axes.annotate(
                str(level.num_polygons), (level.wall_ms, error(level)), (5, 3),
                textcoords="offset points", fontsize=7, color=ORANGE,
            )  # fmt: skip


def _set_time_ticks(axes: Axes, times_ms: Sequence[float]) -> None:
    # Matplotlib labels decades only, and a study spans little more than one.
    low, high = 0.85 * min(times_ms), 1.2 * max(times_ms)
    ticks = [tick for tick in _TICKS_MS if low <= tick <= high]
    axes.set_xlim(low, high)
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()


def _list_front_levels(
    page: Page, front: Sequence[LevelCost], format_error: Callable[[LevelCost], str], *, left: int
) -> None:
    top = _TOP_PX + _PANEL_HEIGHT_PX + 130
    title = "never beaten in time and this error at once"
    add_text(page, left, top, title, fontweight="bold", fontsize=7.5)
    for number, level in enumerate(front, 1):
        text = f"{number}  {level.name}: {level.wall_ms:.1f} ms, {format_error(level)}"
        add_text(page, left, top + 30 * number, text, fontsize=7)


_LEFT_PX, _PANEL_WIDTH_PX, _GAP_PX = 380, 232, 56

_RowValue = Callable[[LocalizationRow], float]
# Panels: title, and series of label, colour and value of a row.
_PANELS: tuple[tuple[str, tuple[tuple[str, str, _RowValue], ...]], ...] = (
    ("beacons found, %", (
        ("to 2.5 m", BLUE, lambda row: 100.0 * row.detection_rate),
        ("to 1.5 m", TEAL, lambda row: 100.0 * row.near_detection_rate),
    )),
    ("bearing, deg rms", (("", BLUE, lambda row: row.bearing_rms_deg),)),
    ("range, m rms", (("", BLUE, lambda row: row.range_rms_m),)),
    ("position, m, mean", (
        ("paper's filter", BLUE, lambda row: row.ekf_mean_m),
        ("consistent one", TEAL, lambda row: row.consistent_ekf_mean_m),
    )),
)  # fmt: skip


def _draw_localization(page: Page, localization: LocalizationAccuracy) -> None:
    """Draw a row for each level, from coarse to exact, in four panels."""
    for index, (title, series) in enumerate(_PANELS):
        left = _LEFT_PX + index * (_PANEL_WIDTH_PX + _GAP_PX)
        axes = add_axes(page, left, 90, _PANEL_WIDTH_PX, 420)
        _draw_localization_panel(axes, localization.rows, series)
        axes.set_title(title, loc="left", fontsize=8)
        if index:
            axes.set_yticklabels([])
    text = (
        f"{localization.num_runs} runs of {localization.steps_per_run} steps; odometry alone ends "
        f"up to {localization.odometry_max_m:.2g} m off (median run)"
    )
    add_text(page, 20, 20, text, color=MUTED)


def _draw_localization_panel(
    axes: Axes, rows: Sequence[LocalizationRow], series: Sequence[tuple[str, str, _RowValue]]
) -> None:
    positions = range(len(rows))
    for label, colour, value in series:
        values = [value(row) for row in rows]
        axes.plot(values, positions, "o-", color=colour, markersize=4, linewidth=0.8, label=label)
    # Downwards from coarse to exact, as in the table of COST.md.
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_yticks(positions, [row.level for row in rows])
    # From zero: the panels compare levels, and a cut axis would make small differences large.
    axes.set_xlim(left=0.0)
    axes.locator_params(axis="x", nbins=3)
    axes.tick_params(axis="x", labelsize=7)
    if len(series) > 1:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=2, fontsize=6.5,
                    handlelength=1.0, columnspacing=0.8, handletextpad=0.4)  # fmt: skip
