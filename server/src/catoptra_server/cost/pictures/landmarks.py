"""What accuracy is worth to a robot: landmarks found, their errors, and the place believed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from catoptra_server.cost.document import Document, LandmarkRow, Landmarks
from catoptra_server.figures import style

WIDTH_PX, HEIGHT_PX = 1520, 620
_LEFT_PX, _PANEL_PX, _GAP_PX = 380, 232, 56

Value = Callable[[LandmarkRow], float]
_PANELS: tuple[tuple[str, tuple[tuple[str, str, Value], ...]], ...] = (
    ("beacons found, %", (
        ("to 2.5 m", style.BLUE, lambda row: 100.0 * row.found),
        ("to 1.5 m", style.TEAL, lambda row: 100.0 * row.found_near),
    )),
    ("bearing, deg rms", (("", style.BLUE, lambda row: row.bearing_rms_deg),)),
    ("range, m rms", (("", style.BLUE, lambda row: row.range_rms_m),)),
    ("place, m, mean of a run", (
        ("paper's filter", style.BLUE, lambda row: row.ekf_mean_m),
        ("honest one", style.TEAL, lambda row: row.honest_ekf_mean_m),
    )),
)  # fmt: skip


def draw(page: style.Page, document: Document) -> None:
    """Draw a row for each step, from coarse to exact, in four panels."""
    landmarks = document.landmarks
    assert landmarks is not None, "drawn only where the client's side has measured"
    for index, (title, series) in enumerate(_PANELS):
        left = _LEFT_PX + index * (_PANEL_PX + _GAP_PX)
        on = style.axes(page, left, 90, _PANEL_PX, 420)
        _panel(on, landmarks.rows, series)
        on.set_title(title, loc="left", fontsize=8)
        if index:
            on.set_yticklabels([])
    _without_eyes(page, landmarks)


def _panel(
    on: style.Axes, rows: Sequence[LandmarkRow], series: Sequence[tuple[str, str, Value]]
) -> None:
    places = range(len(rows))
    for name, colour, value in series:
        values = [value(row) for row in rows]
        on.plot(values, places, "o-", color=colour, markersize=4, linewidth=0.8, label=name)
    on.set_ylim(len(rows) - 0.5, -0.5)
    on.set_yticks(places, [row.step for row in rows])
    on.set_xlim(left=0.0)
    on.locator_params(axis="x", nbins=3)
    on.tick_params(axis="x", labelsize=7)
    if len(series) > 1:
        on.legend(loc="upper center", bbox_to_anchor=(0.5, -0.08), ncols=2, fontsize=6.5,
                  handlelength=1.0, columnspacing=0.8, handletextpad=0.4)  # fmt: skip


def _without_eyes(page: style.Page, landmarks: Landmarks) -> None:
    text = (
        f"{landmarks.runs} runs of {landmarks.steps_a_run} steps; odometry alone ends up to "
        f"{landmarks.odometry_max_m:.2g} m off (median run)"
    )
    style.words(page, 20, 20, text, color=style.QUIET)
