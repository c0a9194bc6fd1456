"""How good the landmark measurements of recorded drives were, against the truth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep
from catoptra_studies.experiment.experiment_setups import MAX_RANGE_M

# Half a metre: within it the number of pixels on a beacon changes by less than two.
_DISTANCE_BIN_M = 0.5


def compute_measurement_metrics(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark]
) -> dict[str, object]:
    """Return range and bearing errors, and the share of near beacons that were measured."""
    pairs = [
        pair for recording in drive_logs for pair in _range_bearing_errors(recording, landmarks)
    ]
    ranges, bearings = np.array(pairs).reshape(-1, 2).T
    return {
        "measurements": len(pairs),
        "range_error_m": _quantiles(ranges),
        "bearing_error_deg": _quantiles(np.degrees(bearings)),
        "beacons_measured_by_distance": detection_rates_by_distance(drive_logs, landmarks),
    }


def rms_errors(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark]
) -> tuple[float, float]:
    """Return the rms errors of range in metres and bearing in degrees; NaN where none was seen."""
    pairs = [
        pair for recording in drive_logs for pair in _range_bearing_errors(recording, landmarks)
    ]
    if not pairs:
        return math.nan, math.nan
    range_m, bearing_rad = np.sqrt(np.mean(np.square(pairs), axis=0))
    return float(range_m), math.degrees(bearing_rad)


def detection_rate(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark], *, max_distance_m: float
) -> float:
    """Return the share of beacons that were measured, of those truly so near; NaN for none."""
    there = seen = 0
    for step in (step for recording in drive_logs for step in recording.steps[1:]):
        names = {measured.name for measured in step.measurements}
        for landmark in landmarks:
            if (
                landmark.kind == "beacon"
                and _true_range_bearing(step, landmark)[0] <= max_distance_m
            ):
                there += 1
                seen += landmark.name in names
    return seen / there if there else math.nan


def _quantiles(values: np.ndarray[tuple[int]]) -> dict[str, float]:
    if not len(values):
        return {}
    low, median, high = np.quantile(values, [0.05, 0.5, 0.95])
    rms = float(np.sqrt(np.mean(np.square(values))))
    return {"p05": float(low), "median": float(median), "p95": float(high), "rms": rms}


def _range_bearing_errors(
    drive_log: DriveLog, landmarks: Sequence[Landmark]
) -> Iterator[tuple[float, float]]:
    """Yield (range error in m, bearing error in rad) of every measurement."""
    by_name = {landmark.name: landmark for landmark in landmarks}
    for step in drive_log.steps:
        for seen in step.measurements:
            range_m, bearing = _true_range_bearing(step, by_name[seen.name])
            yield seen.range_m - range_m, wrap_angle(seen.bearing_rad - bearing)


def _true_range_bearing(step: DriveStep, landmark: Landmark) -> tuple[float, float]:
    dx, dy = landmark.x_m - step.truth.x_m, landmark.y_m - step.truth.y_m
    return math.hypot(dx, dy), wrap_angle(math.atan2(dy, dx) - step.truth.yaw_rad)


def detection_rates_by_distance(
    drive_logs: Sequence[DriveLog], landmarks: Sequence[Landmark]
) -> list[dict[str, float]]:
    """Return the share of beacons that were measured, by their true distance."""
    bins = round(MAX_RANGE_M / _DISTANCE_BIN_M)
    there, seen = np.zeros(bins, dtype=int), np.zeros(bins, dtype=int)
    for recording in drive_logs:
        for step in recording.steps[1:]:
            names = {measured.name for measured in step.measurements}
            for landmark in landmarks:
                number = int(_true_range_bearing(step, landmark)[0] / _DISTANCE_BIN_M)
                if landmark.kind == "beacon" and number < bins:
                    there[number] += 1
                    seen[number] += landmark.name in names
    return [
        {
            "from_m": i * _DISTANCE_BIN_M,
            "to_m": (i + 1) * _DISTANCE_BIN_M,
            "share": float(seen[i] / there[i]),
        }
        for i in range(bins)
        if there[i]
    ]
