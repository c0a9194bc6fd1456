"""Is the filter as sure as it ought to be? Many runs on a circle, NEES and NIS step by step.

Noise is drawn from seeds; the filter believes the noise that is there, or 1 / 2.25 of it.
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
from catoptra_client.localization.measurement_model import predict_measurement
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
    """Means over the runs of each step, (STEPS,); the interval of 95 % of a matched filter."""

    name: str
    size: int
    matched: Floats
    overconfident: Floats
    interval: tuple[float, float]

    @property
    def inside(self) -> float:
        """Return the share of the matched filter's steps that lie in the interval."""
        low, high = self.interval
        return float(((self.matched > low) & (self.matched < high)).mean())


def consistency() -> tuple[Consistency, Consistency]:
    """Return NEES and NIS."""
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
    """Return (STEPS, 2) NEES and NIS of one run; covariances are `believed` times the real ones."""
    rng = np.random.default_rng(seed)
    truth = rng.multivariate_normal(np.zeros(3), P0)
    belief, rows = Belief(np.zeros(3), P0 * believed), []
    real, taken = MotionNoise(*ALPHAS), MotionNoise(*(believed * alpha for alpha in ALPHAS))
    for step in range(STEPS):
        off = np.sqrt(np.diagonal(control_covariance(CONTROL, real))) * rng.normal(size=2)
        truth = propagate_pose(
            truth, Control(CONTROL.distance_m + off[0], CONTROL.turn_rad + off[1])
        )
        belief = predict(belief, CONTROL, noise=taken)
        landmark = LANDMARKS[step % len(LANDMARKS)]
        seen, _ = predict_measurement(truth, landmark)
        off = np.sqrt(np.diagonal(R)) * rng.normal(size=2)
        measured = RangeBearing(seen.range_m + off[0], seen.bearing_rad + off[1], R * believed)
        result = update(belief, measured, landmark=landmark, gate=OPEN_GATE)
        belief = result.belief
        rows.append((nees(belief, truth)[0], result.nis))
    return np.array(rows)
