"""`python -m stability.long_run`: a million steps of the filter among exact landmarks.

Landmarks stand all around and in line with the robot, one of them twice; sensors are exact to 1e-5;
every seventh step is without motion. After each step the covariance must equal its transpose to the
bit and have no negative eigenvalue.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np

from catoptra_client.localization import (
    PAPER_GATE,
    Belief,
    Control,
    LandmarkPosition,
    MotionNoise,
    RangeBearing,
    predict,
    update,
)
from catoptra_client.localization.ekf import predict_measurement, sigmas_and_correlations

MARKS = [
    LandmarkPosition(f"l{i}", x, y)
    for i, (x, y) in enumerate([(2.0, 1.0), (2.0, 1.0), (-2.0, 1.0), (4.0, 2.0), (0.3, -2.0)])
]
EXACT = np.diag([1e-10, 1e-10])
NOISE = MotionNoise(0.01, 0.001, 0.0005, 0.0064)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Worst eigenvalue of the correlations and worst asymmetry; number of rejected updates."""

    smallest_eigenvalue: float
    largest_asymmetry: float
    refused: int


def run(steps: int) -> Outcome:
    """Worst values over this many steps on a small circle, with one landmark per step."""
    belief, refused = Belief(np.zeros(3), np.diag([0.01, 0.01, 0.01])), 0
    smallest, asymmetry = math.inf, 0.0
    for step in range(steps):
        standing = step % 7 == 0
        control = Control(0.0, 0.0) if standing else Control(0.02, 0.1)
        belief = predict(belief, control, noise=NOISE)
        mark = MARKS[step % len(MARKS)]
        expected, _ = predict_measurement(belief.mean, mark)
        off = 1e-5 * math.sin(step)
        measured = RangeBearing(expected.range_m + off, expected.bearing_rad - off, EXACT)
        result = update(belief, measured, landmark=mark, gate=PAPER_GATE)
        belief, refused = result.belief, refused + (not result.is_accepted)
        _, (a, b, c), _ = sigmas_and_correlations(belief.covariance)
        correlation = ((1.0, a, b), (a, 1.0, c), (b, c, 1.0))
        smallest = min(smallest, float(np.linalg.eigvalsh(correlation)[0]))
        asymmetry = max(asymmetry, float(np.abs(belief.covariance - belief.covariance.T).max()))
    return Outcome(smallest, asymmetry, refused)


def main() -> None:
    """Print the worst values of a run."""
    parser = argparse.ArgumentParser(prog="stability.long_run", description=__doc__)
    parser.add_argument("--steps", type=int, default=1_000_000)
    print(run(parser.parse_args().steps))


if __name__ == "__main__":
    main()
