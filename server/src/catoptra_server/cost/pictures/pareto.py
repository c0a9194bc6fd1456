"""Time against error: the bound on the left, what is seen on the right, and the front of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from catoptra_server.cost.document import StepCost
from catoptra_server.cost.pareto import LEAST_GAIN, pareto_front
from catoptra_server.cost.pictures.legend import LOOKS, look_of
from catoptra_server.cost.tables import number
from catoptra_server.figures import style

WIDTH_PX, HEIGHT_PX = 1520, 1150
_TOP_PX, _PANEL_PX, _TALL_PX = 90, 600, 560
_TICKS_MS = (2, 3, 5, 7, 10, 15, 20, 30, 50, 70, 100, 150, 200, 300, 500)

Error = Callable[[StepCost], float]


def draw(page: style.Page, steps: Sequence[StepCost]) -> None:
    """Draw both panels, a legend, and the names of the numbered steps."""
    bound = _panel(
        page, steps, lambda step: step.bound_max_px, left=110,
        title="geometry: no place is farther off, px",
    )  # fmt: skip
    seen = _panel(
        page, steps, lambda step: step.rmse, left=860,
        title="picture: RMSE against the reference, grey levels",
    )  # fmt: skip
    _names(page, bound[1], lambda step: f"{number(step.bound_max_px, 2)} px", left=40)
    _names(page, seen[1], lambda step: f"RMSE {number(step.rmse, 2)}", left=790)
    handles, labels = seen[0].get_legend_handles_labels()
    page.legend(
        handles, labels, loc="upper center", ncols=4, fontsize=6.5, handletextpad=0.1,
        columnspacing=1.0,
    )  # fmt: skip


def _panel(
    page: style.Page, steps: Sequence[StepCost], error: Error, *, left: int, title: str
) -> tuple[style.Axes, list[StepCost]]:
    """Draw the points of all steps, their front as stairs; return the axes and the front."""
    on = style.axes(page, left, _TOP_PX + 30, _PANEL_PX, _TALL_PX)
    on.set(xscale="log", yscale="log", xlabel="a frame, ms")
    on.set_title(title, loc="left", fontsize=8)
    for look in LOOKS:
        of_look = [step for step in steps if look_of(step) is look]
        on.plot(
            [step.ms for step in of_look], [error(step) for step in of_look], look.marker,
            color=look.colour, markersize=4, alpha=0.75, label=look.name,
        )  # fmt: skip
    front = _front(steps, error)
    _counts(on, steps, error)
    _stairs(on, front, error)
    _ticks(on, [step.ms for step in steps])
    return on, front


def _front(steps: Sequence[StepCost], error: Error) -> list[StepCost]:
    points = [(step.ms, error(step)) for step in steps]
    return [steps[index] for index in pareto_front(points, least_gain=LEAST_GAIN)]


def _stairs(on: style.Axes, front: Sequence[StepCost], error: Error) -> None:
    """Draw the front and number it."""
    x, y = [step.ms for step in front], [error(step) for step in front]
    on.plot(x, y, drawstyle="steps-post", color=style.INK, linewidth=0.9, zorder=1)
    on.set_ylim(bottom=0.45 * min(y))
    for row, place in enumerate(zip(x, y, strict=True), 1):
        on.annotate(
            str(row), place, (0, -9), textcoords="offset points", fontsize=7, ha="center",
            va="center", color=style.PAPER, fontweight="bold", zorder=5,
            bbox={"boxstyle": "circle,pad=0.18", "facecolor": style.INK, "edgecolor": "none"},
        )  # fmt: skip


def _counts(on: style.Axes, steps: Sequence[StepCost], error: Error) -> None:
    """Write its number of polygons beside each of the paper's meshes."""
    for step in steps:
        if step.polygons and step.is_key:
            on.annotate(
                str(step.polygons), (step.ms, error(step)), (5, 3), textcoords="offset points",
                fontsize=7, color=style.ORANGE,
            )  # fmt: skip


def _ticks(on: style.Axes, times: Sequence[float]) -> None:
    low, high = 0.85 * min(times), 1.2 * max(times)
    ticks = [tick for tick in _TICKS_MS if low <= tick <= high]
    on.set_xlim(low, high)
    on.set_xticks(ticks, [str(tick) for tick in ticks])
    on.minorticks_off()


def _names(
    page: style.Page, front: Sequence[StepCost], told: Callable[[StepCost], str], *, left: int
) -> None:
    top = _TOP_PX + _TALL_PX + 130
    style.words(page, left, top, "never beaten in time and this error at once", fontweight="bold",
                fontsize=7.5)  # fmt: skip
    for row, step in enumerate(front, 1):
        text = f"{row}  {step.name}: {step.ms:.1f} ms, {told(step)}"
        style.words(page, left, top + 30 * row, text, fontsize=7)
