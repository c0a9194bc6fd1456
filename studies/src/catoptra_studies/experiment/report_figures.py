"""Figures of the drives and of the detector, each written to one PNG file.

Trajectories are the paper's Figure 12, position errors Figure 13, of one run and of all. The
detector is shown in stages: frame, cylinder, colour labels, landmarks found.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from catoptra_client.landmarks import COLOUR_CODES, DetectionStages
from catoptra_client.landmarks.classifier import UInt8Array
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import pixel_from_direction
from catoptra_studies.experiment.drive_log import DriveLog, true_positions
from catoptra_studies.experiment.experiment_runner import DetectorSnapshot
from catoptra_studies.experiment.localization_filter import FilterRun
from catoptra_studies.experiment.metrics import error_quantiles
from catoptra_studies.paper_values import PAPER_EKF_ERROR_M, PAPER_ODOMETRY_ERROR_M
from catoptra_studies.plot_style import (
    ACCEPTED,
    ESTIMATE,
    LANDMARK_COLOURS,
    MUTED,
    ODOMETRY,
    PAGE_WIDTH_IN,
    REJECTED,
    TRUTH,
    Axes,
    add_legend,
    add_text,
    open_chart,
    open_page,
    show_image,
)

# Title, drive and a filter's results over the drive.
TrajectoryPanel = tuple[str, DriveLog, FilterRun]

_ESTIMATE_LABEL = "the paper's filter (EKF)"
_BELOW = "outside lower center"
_LINE_COLOUR = "#c4c9d0"
# Steps near the middle of the four sides and of the diagonal.
_ARROW_STEPS = (11, 32, 53, 74, 89)


def draw_trajectories(
    path: Path, panels: Sequence[TrajectoryPanel], landmarks: Sequence[Landmark]
) -> None:
    """Write a map for each panel, with the world's x up and y to the right."""
    with open_chart(path, figsize=(PAGE_WIDTH_IN, 6.0)) as figure:
        row = figure.subplots(1, len(panels), squeeze=False, sharex=True, sharey=True)[0]
        for axes, (title, drive_log, filter_run) in zip(row, panels, strict=True):
            _draw_field(axes, landmarks)
            _draw_paths(axes, drive_log, filter_run)
            axes.set_title(title)
            axes.set_xlabel("y, m")
        row[0].set_ylabel("x, m")
        # After all fields, since each sets the common limits.
        for axes, (_, _, filter_run) in zip(row, panels, strict=True):
            _widen_to_path(axes, filter_run.odometry)
        add_legend(figure, row[0], loc="lower center", ncols=3)
        # The automatic layout counts neither legend nor titles of axes of equal scale.
        figure.get_layout_engine().set(rect=(0.0, 0.12, 1.0, 0.84))


def _draw_paths(axes: Axes, drive_log: DriveLog, filter_run: FilterRun) -> None:
    """Draw true path, odometry and estimate of one drive."""
    truth, odometry, estimate = true_positions(drive_log), filter_run.odometry, filter_run.estimate
    # Columns swapped: the axes are (y, x), as seen from above with x forward.
    for path, colour, width, label in (
        (truth, TRUTH, 1.6, "true path"),
        (odometry, ODOMETRY, 1.3, "odometry alone"),
        (estimate, ESTIMATE, 1.3, _ESTIMATE_LABEL),
    ):
        axes.plot(path[:, 1], path[:, 0], color=colour, lw=width, label=label)
    # Gaps between the dots are steps in which the gate let nothing pass.
    accepted = estimate[filter_run.num_accepted > 0]
    label = "step with an accepted landmark"
    axes.plot(accepted[:, 1], accepted[:, 0], ".", color=ACCEPTED, ms=4, label=label)
    axes.plot(
        truth[0, 1], truth[0, 0], "o", color=TRUTH, ms=6, mfc="white", zorder=5,
        label="start",
    )  # fmt: skip
    _draw_direction_of_travel(axes, truth)


def _draw_direction_of_travel(axes: Axes, truth: Floats) -> None:
    """Draw an arrow head on each side of the true path, and on the diagonal."""
    for step in _ARROW_STEPS:
        tail, head = truth[step, ::-1], truth[step + 1, ::-1]
        style = {"arrowstyle": "-|>", "color": TRUTH, "mutation_scale": 13, "lw": 0}
        axes.annotate("", head, tail, arrowprops=style, zorder=5)


def _draw_field(axes: Axes, landmarks: Sequence[Landmark]) -> None:
    """Draw the field from above: lines, and every landmark in two colours."""
    # The pitch of the 2006 four-legged league: 5.4 x 3.6 m.
    axes.plot([-1.8, 1.8, 1.8, -1.8, -1.8], [-2.7, -2.7, 2.7, 2.7, -2.7], color=_LINE_COLOUR, lw=1)
    axes.plot([-1.8, 1.8], [0, 0], color=_LINE_COLOUR, lw=1)
    for landmark in landmarks:
        label = _first_label(landmark, landmarks)
        lower = LANDMARK_COLOURS[landmark.lower_colour]
        upper = LANDMARK_COLOURS[landmark.upper_colour]
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


def _widen_to_path(axes: Axes, odometry: Floats) -> None:
    """Move the limits where odometry leaves the surroundings of the field."""
    for (low, high), move, values in (
        (axes.get_xlim(), axes.set_xlim, odometry[:, 1]),
        (axes.get_ylim(), axes.set_ylim, odometry[:, 0]),
    ):
        move(min(low, values.min() - 0.1), max(high, values.max() + 0.1))


def _first_label(landmark: Landmark, landmarks: Sequence[Landmark]) -> str | None:
    """Entry of the legend for the first landmark of a kind; None for the others."""
    first = next(other for other in landmarks if other.kind == landmark.kind)
    texts = {"goal": "goal", "beacon": "beacon: ring upper, disc lower colour"}
    return texts[landmark.kind] if landmark is first else None


def draw_position_errors(path: Path, panels: Sequence[tuple[str, FilterRun]]) -> None:
    """Write the errors of one run for each (title, run), above the decisions of the gate."""
    with open_chart(path, figsize=(PAGE_WIDTH_IN, 3.9)) as figure:
        # One scale for both set-ups, else the real odometry would look no worse than the simulated.
        grid = figure.subplots(
            2,
            len(panels),
            squeeze=False,
            sharey="row",
            sharex="col",
            gridspec_kw={"height_ratios": (3.2, 1.2)},
        )
        for (axes, gate_axes), (title, run) in zip(grid.T, panels, strict=True):
            steps = np.arange(len(run.estimate_error_m))
            odometry = {"color": ODOMETRY, "label": "odometry alone"}
            axes.plot(steps, run.odometry_error_m, **odometry)
            axes.plot(steps, run.estimate_error_m, color=ESTIMATE, label=_ESTIMATE_LABEL)
            _draw_paper_limits(axes, title)
            _draw_gate_bars(gate_axes, run)
        grid[0, 0].set_ylabel("position error, m")
        grid[1, 0].set_ylabel("landmarks")
        _set_integer_ticks(grid[1, 0])
        add_legend(figure, grid[0, 0], grid[1, 0], loc=_BELOW, ncols=3)


def _set_integer_ticks(axes: Axes) -> None:
    """Label whole landmarks, without a sign: those below the axis are rejected ones."""
    low, high = axes.get_ylim()
    # Even numbers alone: the panel is low.
    ticks = range(2 * math.ceil(low / 2), 2 * math.floor(high / 2) + 1, 2)
    axes.set_yticks(ticks, [str(abs(tick)) for tick in ticks])


def _draw_gate_bars(axes: Axes, filter_run: FilterRun) -> None:
    """Draw accepted landmarks of each step upwards and rejected ones downwards."""
    steps = np.arange(len(filter_run.num_measured))
    accepted, rejected = (
        filter_run.num_accepted,
        filter_run.num_measured - filter_run.num_accepted,
    )
    # Rejections below the axis: a lock-out is then a block with nothing above.
    axes.bar(steps, accepted, 0.9, color=ACCEPTED, label="accepted by the gate")
    axes.bar(steps, -rejected, 0.9, color=REJECTED, label="rejected by the gate")
    axes.axhline(0.0, color=MUTED, lw=0.8)
    axes.set_xlabel("step")


def draw_error_ensemble(path: Path, panels: Sequence[tuple[str, Sequence[FilterRun]]]) -> None:
    """Write the median error over the seeds with the band from 5 % to 95 %, for each panel."""
    with open_chart(path, figsize=(PAGE_WIDTH_IN, 3.2)) as figure:
        row = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
        for axes, (title, filter_runs) in zip(row, panels, strict=True):
            for of_odometry, colour, name in (
                (True, ODOMETRY, "odometry alone"),
                (False, ESTIMATE, _ESTIMATE_LABEL),
            ):
                # Quantiles of each step for itself: no single run follows the band's edge.
                p05, median, p95 = error_quantiles(filter_runs, of_odometry=of_odometry)
                steps = np.arange(len(median))
                axes.fill_between(steps, p05, p95, color=colour, alpha=0.18, lw=0)
                label = f"{name}: median of {len(filter_runs)} runs, 5 % to 95 %"
                axes.plot(steps, median, color=colour, label=label)
            _draw_paper_limits(axes, title)
            axes.set_xlabel("step")
        row[0].set_ylabel("position error, m")
        add_legend(figure, row[0], loc=_BELOW, ncols=2)


def _draw_paper_limits(axes: Axes, title: str) -> None:
    """Draw the paper's bound of the filter, and the error that odometry exceeds.

    The texts are in the legend: curves of other seeds would cross them anywhere in the axes.
    """
    for error_m, text, line in (
        (PAPER_EKF_ERROR_M, "0.6 m, the paper's bound of the filter", "--"),
        (PAPER_ODOMETRY_ERROR_M, "1 m, exceeded by the paper's odometry", ":"),
    ):
        axes.axhline(error_m, color=MUTED, lw=1, ls=line, label=text)
    axes.set_title(title)
    # Half a step beyond the last, so that the bar of step 100 is drawn whole.
    axes.set_xlim(0, 100.5)


def draw_classifier_output(path: Path, snapshot: DetectorSnapshot) -> None:
    """Write the frame with bearings, the cylinder, and the labels with the detections."""
    stages = snapshot.stages
    with open_chart(path, figsize=(PAGE_WIDTH_IN, 3.6)) as figure:
        left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.55))
        _draw_bearings(left.subplots(), snapshot)
        above, below = right.subplots(2, 1)
        above.imshow(stages.cylinder)
        above.set_title("cylinder unwarped from the frame")
        below.imshow(_label_image(stages))
        below.set_title("pixels above the threshold of Eq. 3, and landmarks")
        _label_landmarks(below, snapshot)
        for axes in (above, below):
            _set_azimuth_ticks(axes, snapshot)


def _draw_bearings(axes: Axes, snapshot: DetectorSnapshot) -> None:
    """Draw a frame with a ray towards each detected landmark."""
    axes.imshow(snapshot.rgb)
    camera = snapshot.detector.view.camera
    for detection in snapshot.stages.detections:
        # The level direction of the bearing: the ray ends on the horizon, above the landmark.
        direction = np.array(
            [math.cos(detection.bearing_rad), math.sin(detection.bearing_rad), 0.0]
        )
        pixel, _ = pixel_from_direction(camera, direction)
        # imshow has pixel centres at whole numbers, the camera model at +0.5.
        u, v = pixel - 0.5
        centre = [c - 0.5 for c in camera.centre_px]
        axes.plot([centre[0], u], [centre[1], v], color="white", lw=1.2)
    axes.set_title("frame with the bearings found")
    axes.set_axis_off()


def _label_image(stages: DetectionStages) -> UInt8Array:
    """(h, w, 3) image of the labels: landmark colours on a faint cylinder."""
    # A quarter of the contrast keeps the surroundings recognizable behind the labels.
    faint = (255 - (255 - stages.cylinder.mean(axis=-1, keepdims=True)) * 0.25).astype(np.uint8)
    image = np.repeat(faint, 3, axis=-1)
    for colour, code in COLOUR_CODES.items():
        hexadecimal = LANDMARK_COLOURS[colour].lstrip("#")
        image[stages.labels == code] = list(bytes.fromhex(hexadecimal))
    return image


def _label_landmarks(axes: Axes, snapshot: DetectorSnapshot) -> None:
    """Write name, bearing and range of each landmark."""
    num_columns = snapshot.stages.cylinder.shape[1]
    detections = sorted(snapshot.stages.detections, key=lambda detection: detection.bearing_rad)
    for number, detection in enumerate(detections):
        azimuth = np.array(detection.bearing_rad)
        column = snapshot.detector.view.cylinder.column_from_azimuth(azimuth) % num_columns
        range_ = f", {detection.range_m:.2f} m" if detection.has_range else ""
        name = detection.name.replace("_", " ")
        text = f"{name}\n{math.degrees(detection.bearing_rad):.1f}°{range_}"
        axes.annotate(
            text,
            xy=(column, 60),
            # Neighbours alternate between two rows, else their labels would overlap.
            xytext=(min(max(column, 70), num_columns - 70), 128 + 26 * (number % 2)),
            ha="center",
            va="center",
            fontsize=5.5,
            arrowprops={"arrowstyle": "-", "lw": 0.6, "color": MUTED},
        )


def _set_azimuth_ticks(axes: Axes, snapshot: DetectorSnapshot) -> None:
    degrees = np.array([-135, -90, -45, 0, 45, 90, 135])
    cylinder, num_columns = snapshot.detector.view.cylinder, snapshot.stages.cylinder.shape[1]
    columns = [cylinder.column_from_azimuth(np.array(math.radians(d))) for d in degrees]
    labels = [f"{d}°".replace("-", "−") for d in degrees]
    axes.set_xticks([float(c) % num_columns for c in columns], labels)
    axes.set_yticks([])
    axes.grid(visible=False)


_WIDTH_PX, _TOP_PX = 720, 60


def draw_frame_pair(path: Path, panels: tuple[tuple[str, UInt8Array], ...]) -> None:
    """Write the central squares of two (title, frame), in which the mirror is."""
    with open_page(path, _TOP_PX + _WIDTH_PX + 20) as page:
        for index, (title, rgb) in enumerate(panels):
            left = 20 + index * (_WIDTH_PX + 40)
            add_text(page, left, _TOP_PX - 12, title, va="bottom", fontweight="bold")
            show_image(page, _central_square(rgb), left, _TOP_PX, _WIDTH_PX)


def _central_square(rgb: UInt8Array) -> UInt8Array:
    """The largest square around the centre: the mirror's disc touches the sides."""
    rows, columns = rgb.shape[:2]
    size = min(rows, columns)
    top, left = (rows - size) // 2, (columns - size) // 2
    return rgb[top : top + size, left : left + size]


def draw_overview(
    path: Path, snapshot: DetectorSnapshot, drive_log: DriveLog, filter_run: FilterRun
) -> None:
    """Write the frame with bearings, and the map of a drive with a filter's results."""
    with open_chart(path, figsize=(PAGE_WIDTH_IN, 4.2)) as figure:
        left, right = figure.subplots(1, 2, width_ratios=(1.25, 1.0))
        _draw_bearings(left, snapshot)
        left.set_title("frame of the mirror camera, with the landmarks found")
        _draw_field(right, snapshot.detector.landmarks)
        _draw_paths(right, drive_log, filter_run)
        _widen_to_path(right, filter_run.odometry)
        right.set_title("localized by them on a drive of 100 steps")
        # The figure is shown small; trajectories.png has the axes in metres.
        right.set_xticks([])
        right.set_yticks([])
        right.spines[:].set_visible(False)
        right.legend(loc="upper center", bbox_to_anchor=(0.5, 0.02), ncols=2, fontsize=7)
