"""Manual measurements: the truth with the set-up's noise, of near landmarks only."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.landmarks import read_landmarks
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_studies.experiment.drive_log import LandmarkMeasurement, manual_measurement
from catoptra_studies.experiment.experiment_setups import MAX_RANGE_M, REAL
from catoptra_studies.experiment.route import Waypoint
from helpers.worlds import make_omni_camera

FIELD = read_landmarks(Path(__file__).parents[3] / "configs" / "landmarks" / "four_legged_2006.csv")
CAMERA = make_omni_camera(width_px=360)
HEIGHT_M = 0.6
HERE = Waypoint(0.4, -0.9, 0.6)


def measure(setup, count, *, seed=3, robot="Run0") -> list[tuple[LandmarkMeasurement, ...]]:
    function = manual_measurement(setup, CAMERA, HEIGHT_M, FIELD, seed=seed, robot_name=robot)
    return [function(HERE) for _ in range(count)]


def true_range_bearing(name: str) -> tuple[float, float]:
    mark = next(m for m in FIELD if m.name == name)
    dx, dy = mark.x_m - HERE.x_m, mark.y_m - HERE.y_m
    return math.hypot(dx, dy), wrap_angle(math.atan2(dy, dx) - HERE.yaw_rad)


def test_without_noise_the_measurement_is_the_truth():
    exact = replace(REAL, manual_sigma_px=0.0, manual_sigma_rad=0.0)
    (seen,) = measure(exact, 1)
    assert seen
    for measured in seen:
        assert (measured.range_m, measured.bearing_rad) == pytest.approx(
            true_range_bearing(measured.name)
        )


def test_only_landmarks_within_range_are_measured():
    (seen,) = measure(REAL, 1)
    near = {m.name for m in FIELD if true_range_bearing(m.name)[0] <= MAX_RANGE_M}
    assert {measured.name for measured in seen} == near


def test_noise_has_the_stated_size():
    # 4000 samples: a standard deviation is known to 1.1 %, so 5 % is more than four of those.
    name = measure(REAL, 1)[0][0].name
    _, bearing = true_range_bearing(name)
    measured = [next(s for s in seen if s.name == name) for seen in measure(REAL, 4000)]
    bearings = np.array([wrap_angle(s.bearing_rad - bearing) for s in measured])
    assert bearings.std() == pytest.approx(math.radians(1.0), rel=0.05)
    t = np.array([s.range_m / (math.hypot(s.range_m, HEIGHT_M) + HEIGHT_M) for s in measured])
    radii_px = CAMERA.scale_px * CAMERA.projection.radius_ratio_from_t(t)
    assert radii_px.std() == pytest.approx(1.0, rel=0.05)


def test_same_seed_and_run_give_the_same_measurements():
    assert measure(REAL, 3) == measure(REAL, 3)
    assert measure(REAL, 3) != measure(REAL, 3, seed=4)
    assert measure(REAL, 3) != measure(REAL, 3, robot="Run1")
