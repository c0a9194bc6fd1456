"""Detection rates, measurement errors and position errors with the frames of each key level."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from catoptra_studies import plot_style
from catoptra_studies.accuracy_cost.cost_results import LocalizationAccuracy, LocalizationRow

LOCALIZATION_HEIGHT_PX = 620
_LEFT_PX, _PANEL_WIDTH_PX, _GAP_PX = 380, 232, 56

RowValue = Callable[[LocalizationRow], float]
# Title of each panel, and its series: label, colour, value of a row.
_PANELS: tuple[tuple[str, tuple[tuple[str, str, RowValue], ...]], ...] = (
    ("beacons found, %", (
        ("to 2.5 m", plot_style.BLUE, lambda row: 100.0 * row.detection_rate),
        ("to 1.5 m", plot_style.TEAL, lambda row: 100.0 * row.near_detection_rate),
    )),
    ("bearing, deg rms", (("", plot_style.BLUE, lambda row: row.bearing_rms_deg),)),
    ("range, m rms", (("", plot_style.BLUE, lambda row: row.range_rms_m),)),
    ("position, m, mean", (
        ("paper's filter", plot_style.BLUE, lambda row: row.ekf_mean_m),
        ("consistent one", plot_style.TEAL, lambda row: row.consistent_ekf_mean_m),
    )),
)  # fmt: skip


def draw_localization(page: plot_style.Page, localization: LocalizationAccuracy) -> None:
    """Draw a row for each level, from coarse to exact, in four panels."""
    for index, (title, series) in enumerate(_PANELS):
        left = _LEFT_PX + index * (_PANEL_WIDTH_PX + _GAP_PX)
        axes = plot_style.add_axes(page, left, 90, _PANEL_WIDTH_PX, 420)
        _draw_panel(axes, localization.rows, series)
        axes.set_title(title, loc="left", fontsize=8)
        if index:
            axes.set_yticklabels([])
    _draw_odometry_note(page, localization)


def _draw_panel(
    axes: plot_style.Axes,
    rows: Sequence[LocalizationRow],
    series: Sequence[tuple[str, str, RowValue]],
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


def _draw_odometry_note(page: plot_style.Page, localization: LocalizationAccuracy) -> None:
    text = (
        f"{localization.num_runs} runs of {localization.steps_per_run} steps; odometry alone ends "
        f"up to {localization.odometry_max_m:.2g} m off (median run)"
    )
    plot_style.add_text(page, 20, 20, text, color=plot_style.MUTED)
