"""Errors of landmark measurements and detection rates, by comparison with the true poses."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep
from catoptra_studies.experiment.experiment_setups import MAX_RANGE_M

# Range in metres and bearing in radians, or the errors of both.
RangeBearingPair = tuple[float, float]

# Within half a metre the number of pixels across a beacon changes by less than two.
_DISTANCE_BIN_M = 0.5


def compute_measurement_metrics(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark]
) -> dict[str, object]:
    """Quantiles of range and bearing errors, and detection rates by distance, as for JSON."""
    errors = _all_errors(drive_logs, landmarks)
    # reshape keeps two columns even where no landmark was measured.
    range_errors_m, bearing_errors_rad = np.array(errors).reshape(-1, 2).T
    return {
        "measurements": len(errors),
        "range_error_m": _quantiles(range_errors_m),
        "bearing_error_deg": _quantiles(np.degrees(bearing_errors_rad)),
        "beacons_measured_by_distance": detection_rates_by_distance(drive_logs, landmarks),
    }


def rms_errors(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark]
) -> tuple[float, float]:
    """Root mean square errors of range in metres and bearing in degrees; nan for none."""
    range_m, bearing_rad = rms_range_bearing(_all_errors(drive_logs, landmarks))
    return range_m, math.degrees(bearing_rad)


def rms_range_bearing(errors: Sequence[RangeBearingPair]) -> RangeBearingPair:
    """Root mean square of pairs of errors; nan for none."""
    if not errors:
        return math.nan, math.nan
    range_m, bearing_rad = np.sqrt(np.mean(np.square(errors), axis=0))
    return float(range_m), float(bearing_rad)


def detection_rate(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark], *, max_distance_m: float
) -> float:
    """Fraction of the beacons within a true distance that were measured; nan for none."""
    num_near = num_measured = 0
    for distance_m, is_measured in _beacon_distances(drive_logs, landmarks):
        if distance_m <= max_distance_m:
            num_near += 1
            num_measured += is_measured
    return num_measured / num_near if num_near else math.nan


def detection_rates_by_distance(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark]
) -> list[dict[str, float]]:
    """Detection rate of the beacons in each interval of true distance that has any."""
    num_bins = round(MAX_RANGE_M / _DISTANCE_BIN_M)
    num_near, num_measured = np.zeros(num_bins, dtype=int), np.zeros(num_bins, dtype=int)
    for distance_m, is_measured in _beacon_distances(drive_logs, landmarks):
        index = int(distance_m / _DISTANCE_BIN_M)
        if index < num_bins:
            num_near[index] += 1
            num_measured[index] += is_measured
    return [
        {
            "from_m": index * _DISTANCE_BIN_M,
            "to_m": (index + 1) * _DISTANCE_BIN_M,
            "rate": float(num_measured[index] / num_near[index]),
        }
        for index in range(num_bins)
        if num_near[index]
    ]


def true_range_bearing(step: DriveStep, landmark: Landmark) -> RangeBearingPair:
    """True range and bearing of a landmark from the pose after a step."""
    dx, dy = landmark.x_m - step.truth.x_m, landmark.y_m - step.truth.y_m
    return math.hypot(dx, dy), wrap_angle(math.atan2(dy, dx) - step.truth.yaw_rad)


def _beacon_distances(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark]
) -> Iterator[tuple[float, bool]]:
    """Yield true distance, and whether measured, of every beacon in every step."""
    # The start has no measurements and would count every beacon as missed.
    for step in (step for drive_log in drive_logs for step in drive_log.steps[1:]):
        # By name: a landmark is measured at most once in a step.
        names = {measurement.name for measurement in step.measurements}
        for landmark in landmarks:
            if landmark.kind == "beacon":
                yield true_range_bearing(step, landmark)[0], landmark.name in names


def _all_errors(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark]
) -> list[RangeBearingPair]:
    """Errors of every measurement of every drive."""
    by_name = {landmark.name: landmark for landmark in landmarks}
    errors = []
    for step in (step for drive_log in drive_logs for step in drive_log.steps):
        for measurement in step.measurements:
            range_m, bearing_rad = true_range_bearing(step, by_name[measurement.name])
            bearing_error_rad = wrap_angle(measurement.bearing_rad - bearing_rad)
            errors.append((measurement.range_m - range_m, bearing_error_rad))
    return errors


def _quantiles(values: np.ndarray[tuple[int]]) -> dict[str, float]:
    if not len(values):
        # An empty object for none: quantiles of null would need a test each in every reader.
        return {}
    p05, median, p95 = np.quantile(values, [0.05, 0.5, 0.95])
    rms = float(np.sqrt(np.mean(np.square(values))))
    return {"p05": float(p05), "median": float(median), "p95": float(p95), "rms": rms}
