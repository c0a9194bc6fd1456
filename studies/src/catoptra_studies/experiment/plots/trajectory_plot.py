"""The paper's Figure 12: true path, odometry alone and the filter's estimate on the field."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import Floats
from catoptra_studies import plot_style
from catoptra_studies.experiment.drive_log import DriveLog, Positions, true_positions
from catoptra_studies.experiment.filter_replay import FilterRun

# Title, drive and a filter's results over the drive.
TrajectoryPanel = tuple[str, DriveLog, FilterRun]

_LINE_COLOUR = "#c4c9d0"
# Steps near the middle of the four sides and of the diagonal.
_ARROW_STEPS = (11, 32, 53, 74, 89)


def draw_trajectories(
    path: Path, panels: Sequence[TrajectoryPanel], landmarks: Sequence[Landmark]
) -> None:
    """Write a map for each panel, with the world's x up and y to the right."""
    with plot_style.open_chart(path, figsize=(plot_style.PAGE_WIDTH_IN, 6.0)) as figure:
        row = figure.subplots(1, len(panels), squeeze=False, sharex=True, sharey=True)[0]
        for axes, (title, drive_log, filter_run) in zip(row, panels, strict=True):
            draw_field(axes, landmarks)
            draw_paths(axes, drive_log, filter_run)
            axes.set_title(title)
            axes.set_xlabel("y, m")
        row[0].set_ylabel("x, m")
        # After all fields, since each sets the common limits.
        for axes, (_, _, filter_run) in zip(row, panels, strict=True):
            widen_to_path(axes, filter_run.odometry)
        handles, labels = row[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="lower center", ncols=3)
        # The automatic layout counts neither legend nor titles of axes of equal scale.
        figure.get_layout_engine().set(rect=(0.0, 0.12, 1.0, 0.84))


def draw_paths(axes: plot_style.Axes, drive_log: DriveLog, filter_run: FilterRun) -> None:
    """Draw true path, odometry and estimate of one drive."""
    truth, odometry, estimate = true_positions(drive_log), filter_run.odometry, filter_run.estimate
    # Columns swapped: the axes are (y, x), as seen from above with x forward.
    for path, colour, width, label in (
        (truth, plot_style.TRUTH, 1.6, "true path"),
        (odometry, plot_style.ODOMETRY, 1.3, "odometry alone"),
        (estimate, plot_style.ESTIMATE, 1.3, "the paper's filter (EKF)"),
    ):
        axes.plot(path[:, 1], path[:, 0], color=colour, lw=width, label=label)
    # Gaps between the dots are steps in which the gate let nothing pass.
    accepted = estimate[filter_run.num_accepted > 0]
    label = "step with an accepted landmark"
    axes.plot(accepted[:, 1], accepted[:, 0], ".", color=plot_style.ACCEPTED, ms=4, label=label)
    axes.plot(
        truth[0, 1], truth[0, 0], "o", color=plot_style.TRUTH, ms=6, mfc="white", zorder=5,
        label="start",
    )  # fmt: skip
    _draw_direction_of_travel(axes, truth)


def _draw_direction_of_travel(axes: plot_style.Axes, truth: Positions) -> None:
    """Draw an arrow head on each side of the true path, and on the diagonal."""
    for step in _ARROW_STEPS:
        tail, head = truth[step, ::-1], truth[step + 1, ::-1]
        style = {"arrowstyle": "-|>", "color": plot_style.TRUTH, "mutation_scale": 13, "lw": 0}
        axes.annotate("", head, tail, arrowprops=style, zorder=5)


def draw_field(axes: plot_style.Axes, landmarks: Sequence[Landmark]) -> None:
    """Draw the field from above: its lines, and every landmark in its colours."""
    # The pitch of the 2006 four-legged league: 5.4 x 3.6 m.
    axes.plot([-1.8, 1.8, 1.8, -1.8, -1.8], [-2.7, -2.7, 2.7, 2.7, -2.7], color=_LINE_COLOUR, lw=1)
    axes.plot([-1.8, 1.8], [0, 0], color=_LINE_COLOUR, lw=1)
    for landmark in landmarks:
        label = _first_label(landmark, landmarks)
        lower = plot_style.LANDMARK_COLOURS[landmark.lower_colour]
        upper = plot_style.LANDMARK_COLOURS[landmark.upper_colour]
        # Goals are drawn with their true width, beacons as rings around their lower colour.
        if landmark.kind == "goal":
            half_m = 0.5 * landmark.width_m
            ends = [landmark.y_m - half_m, landmark.y_m + half_m]
            axes.plot(
                ends, [landmark.x_m] * 2, color=upper, lw=4, solid_capstyle="butt", label=label
            )
        else:
            axes.plot(
                landmark.y_m, landmark.x_m, "o", ms=8, mfc=lower, mec=upper, mew=2.5, ls="",
                label=label,
            )  # fmt: skip
    axes.set_aspect("equal")
    axes.set_xlim(-2.7, 2.7)
    axes.set_ylim(-3.3, 3.5)


def widen_to_path(axes: plot_style.Axes, odometry: Floats) -> None:
    """Move the limits where odometry leaves the surroundings of the field."""
    for (low, high), move, values in (
        (axes.get_xlim(), axes.set_xlim, odometry[:, 1]),
        (axes.get_ylim(), axes.set_ylim, odometry[:, 0]),
    ):
        move(min(low, values.min() - 0.1), max(high, values.max() + 0.1))


def _first_label(landmark: Landmark, landmarks: Sequence[Landmark]) -> str | None:
    """Entry of the legend for the first landmark of its kind; None for the others."""
    first = next(other for other in landmarks if other.kind == landmark.kind)
    texts = {"goal": "goal", "beacon": "beacon: ring upper, disc lower colour"}
    return texts[landmark.kind] if landmark is first else None
