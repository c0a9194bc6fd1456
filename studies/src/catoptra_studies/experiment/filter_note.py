"""The note that shows a filter's belief to the viewers of its robot, such as the live page.

SPEC.md 9.7 lists the keys that viewers draw.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_client.localization import Belief, MeasurementUpdate
from catoptra_studies.experiment.filter_step import FilterStep
from catoptra_studies.experiment.landmark_measurement import LandmarkMeasurement

NOTE_NAME = "ekf"


def note_from_filter_step(step: FilterStep) -> dict[str, object]:
    """Belief, detections and a line of text: metres, radians, the world frame."""
    measurements = zip(step.drive_step.measurements, step.updates, strict=True)
    return {
        **belief_entries(step.belief),
        "detections": [_note_detection(*measured) for measured in measurements],
        "text": describe_filter_step(step),
    }


def belief_entries(belief: Belief) -> dict[str, object]:
    """Entries of a note about a belief alone."""
    return {"pose": belief.mean, "covariance": belief.covariance.ravel()}


def describe_filter_step(step: FilterStep) -> str:
    """Error of the belief, its standard deviations, and what the gate decided."""
    truth, mean = step.drive_step.truth, step.belief.mean
    error_m = math.hypot(mean[0] - truth.x_m, mean[1] - truth.y_m)
    sigma_x, sigma_y, sigma_yaw = np.sqrt(np.diagonal(step.belief.covariance))
    num_accepted = sum(update.is_accepted for update in step.updates)
    return (
        f"{error_m:.2f} m from the truth, σ {math.hypot(sigma_x, sigma_y):.2f} m and "
        f"{math.degrees(sigma_yaw):.1f}°; the gate accepts {num_accepted} of "
        f"{len(step.updates)} landmarks"
    )


def _note_detection(
    measurement: LandmarkMeasurement, update: MeasurementUpdate
) -> dict[str, object]:
    return {
        "landmark": measurement.name,
        "bearing_rad": measurement.bearing_rad,
        "range_m": measurement.range_m,
        "accepted": update.is_accepted,
    }
