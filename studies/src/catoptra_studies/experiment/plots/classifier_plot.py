"""What the classifier sees: frame, cylinder, colour labels, and the landmarks found in them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_client.landmarks import COLOUR_CODES, DetectionStages, Detector
from catoptra_client.landmarks.histogram import UInt8Array
from catoptra_protocol.optics.omni_camera import pixel_from_direction
from catoptra_studies.experiment.plots import drive_plot_style


def draw_classifier_output(
    path: Path, frame: UInt8Array, detector: Detector, stages: DetectionStages
) -> None:
    """Write the omni frame with bearings, the cylinder, and its labels with the detections."""
    with drive_plot_style.open_figure(path, figsize=(11.0, 5.2)) as drawing:
        left, right = drawing.subfigures(1, 2, width_ratios=(1.0, 1.55))
        draw_bearings(left.subplots(), frame, detector, stages)
        above, below = right.subplots(2, 1)
        above.imshow(stages.cylinder)
        above.set_title("cylinder unwarped from the frame")
        below.imshow(_label_image(stages))
        below.set_title("pixels that pass Eq. 3, and the landmarks built of them")
        _label_landmarks(below, detector, stages)
        for axis in (above, below):
            _set_azimuth_ticks(axis, stages.cylinder.shape[1], detector)


def draw_bearings(
    axes: Any, frame: UInt8Array, detector: Detector, stages: DetectionStages
) -> None:
    """Draw a frame and a ray towards each landmark found in it."""
    axes.imshow(frame)
    camera = detector.view.camera
    for detection in stages.detections:
        direction = np.array(
            [math.cos(detection.bearing_rad), math.sin(detection.bearing_rad), 0.0]
        )
        pixel, _ = pixel_from_direction(camera, direction)
        u, v = pixel - 0.5  # imshow counts pixel centres as integers
        centre = [c - 0.5 for c in camera.centre_px]
        axes.plot([centre[0], u], [centre[1], v], color="white", lw=1.2)
    axes.set_title("omnidirectional frame with the bearings found")
    axes.set_axis_off()


def _label_image(stages: DetectionStages) -> UInt8Array:
    """Return the labels as a picture: landmark colours on a faint cylinder."""
    painted = (255 - (255 - stages.cylinder.mean(axis=-1, keepdims=True)) * 0.25).astype(np.uint8)
    painted = np.repeat(painted, 3, axis=-1)
    for colour, code in COLOUR_CODES.items():
        hexadecimal = drive_plot_style.LANDMARK_COLOURS[colour].lstrip("#")
        painted[stages.labels == code] = list(bytes.fromhex(hexadecimal))
    return painted


def _label_landmarks(axes: Any, detector: Detector, stages: DetectionStages) -> None:
    """Write name, bearing and range over each landmark; labels that would touch are stacked."""
    columns = stages.cylinder.shape[1]
    ordered = sorted(stages.detections, key=lambda d: d.bearing_rad)
    for number, detection in enumerate(ordered):
        column = (
            detector.view.cylinder.column_from_azimuth(np.array(detection.bearing_rad)) % columns
        )
        range_ = f", {detection.range_m:.2f} m" if detection.has_range else ""
        name = detection.name.replace("_", " ")
        text = f"{name}\n{math.degrees(detection.bearing_rad):.1f}°{range_}"
        axes.annotate(
            text,
            xy=(column, 60),
            xytext=(min(max(column, 70), columns - 70), 128 + 26 * (number % 2)),
            ha="center",
            va="center",
            fontsize=7,
            arrowprops={"arrowstyle": "-", "lw": 0.6, "color": drive_plot_style.MUTED},
        )


def _set_azimuth_ticks(axes: Any, columns: int, detector: Detector) -> None:
    degrees = np.array([-135, -90, -45, 0, 45, 90, 135])
    places = [
        detector.view.cylinder.column_from_azimuth(np.array(math.radians(d))) for d in degrees
    ]
    axes.set_xticks([float(p) % columns for p in places], [f"{d}°" for d in degrees])
    axes.set_yticks([])
    axes.grid(visible=False)
