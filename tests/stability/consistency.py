"""Consistency of the filter: NEES and NIS per step over many runs on a circle.

Noise is seeded; the filter assumes the true noise, or 1 / 2.25 of the true variances.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from catoptra_client.localization import (
    OPEN_GATE,
    Belief,
    Control,
    LandmarkPosition,
    MotionNoise,
    RangeBearing,
    chi_square_mean_interval,
    nees,
    predict,
    update,
)
from catoptra_client.localization.ekf import predict_measurement
from catoptra_client.localization.motion_model import control_covariance, propagate_pose
from catoptra_protocol.optics.numerics import Floats

RUNS, STEPS = 50, 60
OVERCONFIDENT = 1.0 / 2.25
LANDMARKS = [LandmarkPosition(f"l{i}", x, y) for i, (x, y) in enumerate([(3, 2), (-3, 2), (0, -3)])]
ALPHAS = (0.01, 0.001, 0.001, 0.0064)
R = np.diag([0.05**2, math.radians(1.0) ** 2])
P0 = np.diag([0.05**2, 0.05**2, math.radians(3.0) ** 2])
CONTROL = Control(0.2, 0.1)


@dataclass(frozen=True, slots=True, eq=False)
class Consistency:
    """Means over the runs per step, (STEPS,), and the 95 % interval of a matched filter."""

    name: str
    size: int
    matched: Floats
    overconfident: Floats
    interval: tuple[float, float]

    @property
    def inside(self) -> float:
        """Fraction of the matched filter's steps within the interval."""
        low, high = self.interval
        return float(((self.matched > low) & (self.matched < high)).mean())


def consistency() -> tuple[Consistency, Consistency]:
    """NEES and NIS of the matched and the overconfident filter."""
    matched, over = (
        np.array([run(seed, believed=believed) for seed in range(RUNS)]).mean(axis=0)
        for believed in (1.0, OVERCONFIDENT)
    )
    nees_of, nis_of = (
        Consistency(name, size, matched[:, row], over[:, row], chi_square_mean_interval(size, RUNS))
        for row, (name, size) in enumerate((("NEES", 3), ("NIS", 2)))
    )
    return nees_of, nis_of


def run(seed: int, *, believed: float) -> Floats:
    """NEES and NIS (STEPS, 2) of a run; assumed covariances are `believed` times the true ones."""
    rng = np.random.default_rng(seed)
    truth = rng.multivariate_normal(np.zeros(3), P0)
    belief, rows = Belief(np.zeros(3), P0 * believed), []
    true_noise, assumed_noise = (
        MotionNoise(*ALPHAS),
        MotionNoise(*(believed * alpha for alpha in ALPHAS)),
    )
    for step in range(STEPS):
        off = np.sqrt(np.diagonal(control_covariance(CONTROL, true_noise))) * rng.normal(size=2)
        truth = propagate_pose(
            truth, Control(CONTROL.distance_m + off[0], CONTROL.turn_rad + off[1])
        )
        belief = predict(belief, CONTROL, noise=assumed_noise)
        landmark = LANDMARKS[step % len(LANDMARKS)]
        expected, _ = predict_measurement(truth, landmark)
        off = np.sqrt(np.diagonal(R)) * rng.normal(size=2)
        measured = RangeBearing(
            expected.range_m + off[0], expected.bearing_rad + off[1], R * believed
        )
        result = update(belief, measured, landmark=landmark, gate=OPEN_GATE)
        belief = result.belief
        rows.append((nees(belief, truth)[0], result.nis))
    return np.array(rows)
