"""How good the landmark measurements of recorded drives were, against the truth."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from catoptra_client.experiment.recording import Recording, Step
from catoptra_client.experiment.setups import LONGEST_RANGE_M
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import wrap_angle

# Half a metre: within it the number of pixels on a beacon changes by less than two.
_BIN_M = 0.5


def measurement_figures(
    recordings: Sequence[Recording], landmarks: Sequence[Landmark]
) -> dict[str, object]:
    """Return range and bearing errors, and the share of near beacons that were measured."""
    pairs = [pair for recording in recordings for pair in _errors(recording, landmarks)]
    ranges, bearings = np.array(pairs).reshape(-1, 2).T
    return {
        "measurements": len(pairs),
        "range_error_m": _quantiles(ranges),
        "bearing_error_deg": _quantiles(np.degrees(bearings)),
        "beacons_measured_by_distance": detection_rates(recordings, landmarks),
    }


def rms_errors(
    recordings: Sequence[Recording], landmarks: Sequence[Landmark]
) -> tuple[float, float]:
    """Return the rms errors of range in metres and bearing in degrees; NaN where none was seen."""
    pairs = [pair for recording in recordings for pair in _errors(recording, landmarks)]
    if not pairs:
        return math.nan, math.nan
    range_m, bearing_rad = np.sqrt(np.mean(np.square(pairs), axis=0))
    return float(range_m), math.degrees(bearing_rad)


def found_share(
    recordings: Sequence[Recording], landmarks: Sequence[Landmark], *, within_m: float
) -> float:
    """Return the share of beacons that were measured, of those truly so near; NaN for none."""
    there = seen = 0
    for step in (step for recording in recordings for step in recording.steps[1:]):
        names = {measured.name for measured in step.seen}
        for landmark in landmarks:
            if landmark.kind == "beacon" and _true_polar(step, landmark)[0] <= within_m:
                there += 1
                seen += landmark.name in names
    return seen / there if there else math.nan


def _quantiles(values: np.ndarray[tuple[int]]) -> dict[str, float]:
    if not len(values):
        return {}
    low, median, high = np.quantile(values, [0.05, 0.5, 0.95])
    rms = float(np.sqrt(np.mean(np.square(values))))
    return {"p05": float(low), "median": float(median), "p95": float(high), "rms": rms}


def _errors(recording: Recording, landmarks: Sequence[Landmark]) -> Iterator[tuple[float, float]]:
    """Yield (range error in m, bearing error in rad) of every measurement."""
    by_name = {landmark.name: landmark for landmark in landmarks}
    for step in recording.steps:
        for seen in step.seen:
            range_m, bearing = _true_polar(step, by_name[seen.name])
            yield seen.range_m - range_m, wrap_angle(seen.bearing_rad - bearing)


def _true_polar(step: Step, landmark: Landmark) -> tuple[float, float]:
    dx, dy = landmark.x_m - step.truth.x_m, landmark.y_m - step.truth.y_m
    return math.hypot(dx, dy), wrap_angle(math.atan2(dy, dx) - step.truth.yaw_rad)


def detection_rates(
    recordings: Sequence[Recording], landmarks: Sequence[Landmark]
) -> list[dict[str, float]]:
    """Return the share of beacons that were measured, by their true distance."""
    bins = round(LONGEST_RANGE_M / _BIN_M)
    there, seen = np.zeros(bins, dtype=int), np.zeros(bins, dtype=int)
    for recording in recordings:
        for step in recording.steps[1:]:
            names = {measured.name for measured in step.seen}
            for landmark in landmarks:
                number = int(_true_polar(step, landmark)[0] / _BIN_M)
                if landmark.kind == "beacon" and number < bins:
                    there[number] += 1
                    seen[number] += landmark.name in names
    return [
        {"from_m": i * _BIN_M, "to_m": (i + 1) * _BIN_M, "share": float(seen[i] / there[i])}
        for i in range(bins)
        if there[i]
    ]
