"""Stages of the detector: frame, cylinder, colour labels, and the detected landmarks."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from catoptra_client.landmarks import COLOUR_CODES, DetectionStages, Detector
from catoptra_client.landmarks.classifier import UInt8Array
from catoptra_protocol.optics.omni_camera import pixel_from_direction
from catoptra_studies import plot_style


def draw_classifier_output(
    path: Path, rgb: UInt8Array, detector: Detector, stages: DetectionStages
) -> None:
    """Write the frame with bearings, the cylinder, and the labels with the detections.

    Args:
        path: PNG file to write.
        rgb: (h, w, 3) frame.
        detector: Detector that was used.
        stages: Results of all stages for this frame.
    """
    with plot_style.open_chart(path, figsize=(plot_style.PAGE_WIDTH_IN, 3.6)) as figure:
        left, right = figure.subfigures(1, 2, width_ratios=(1.0, 1.55))
        draw_bearings(left.subplots(), rgb, detector, stages)
        above, below = right.subplots(2, 1)
        above.imshow(stages.cylinder)
        above.set_title("cylinder unwarped from the frame")
        below.imshow(_label_image(stages))
        below.set_title("pixels above the threshold of Eq. 3, and landmarks")
        _label_landmarks(below, detector, stages)
        for axes in (above, below):
            _set_azimuth_ticks(axes, stages.cylinder.shape[1], detector)


def draw_bearings(
    axes: plot_style.Axes, rgb: UInt8Array, detector: Detector, stages: DetectionStages
) -> None:
    """Draw a frame with a ray towards each detected landmark."""
    axes.imshow(rgb)
    camera = detector.view.camera
    for detection in stages.detections:
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
        hexadecimal = plot_style.LANDMARK_COLOURS[colour].lstrip("#")
        image[stages.labels == code] = list(bytes.fromhex(hexadecimal))
    return image


def _label_landmarks(axes: plot_style.Axes, detector: Detector, stages: DetectionStages) -> None:
    """Write name, bearing and range of each landmark."""
    num_columns = stages.cylinder.shape[1]
    detections = sorted(stages.detections, key=lambda detection: detection.bearing_rad)
    for number, detection in enumerate(detections):
        azimuth = np.array(detection.bearing_rad)
        column = detector.view.cylinder.column_from_azimuth(azimuth) % num_columns
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
            arrowprops={"arrowstyle": "-", "lw": 0.6, "color": plot_style.MUTED},
        )


def _set_azimuth_ticks(axes: plot_style.Axes, num_columns: int, detector: Detector) -> None:
    degrees = np.array([-135, -90, -45, 0, 45, 90, 135])
    cylinder = detector.view.cylinder
    columns = [cylinder.column_from_azimuth(np.array(math.radians(d))) for d in degrees]
    labels = [f"{d}°".replace("-", "−") for d in degrees]
    axes.set_xticks([float(c) % num_columns for c in columns], labels)
    axes.set_yticks([])
    axes.grid(visible=False)
