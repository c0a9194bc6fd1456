"""The paper's two set-ups, and the filters that are compared on their drives.

Both filters of the paper have the same parameters, which are not given. These were chosen to
reproduce the findings: odometry above 1 m, the gate's lock-out, the re-lock near step 23.

In containers the set-ups are two servers of one image. The client waits for them itself, so engines
without health checks will do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from catoptra_client.localization import PAPER_GATE, MotionNoise, ValidationGate
from catoptra_studies.experiment.route import Waypoint, clockwise_route, counter_clockwise_route


class MeasurementSource(Enum):
    """Origin of landmark measurements; the values are texts of the report."""

    DETECTOR = "found by the colour classifier in frames received over TCP"
    MANUAL = "taken from ground truth with measurement noise, as by hand from recorded frames"


@dataclass(frozen=True, slots=True)
class ExperimentSetup:
    """One set-up: robot, route and measurements."""

    name: str
    title: str
    robot_file: str
    route: tuple[Waypoint, ...]
    measurement_source: MeasurementSource

    initial_heading_error_rad: float
    """Error of the believed start, clockwise."""

    manual_sigma_px: float = 0.0
    """Noise of manual measurements along the image radius."""

    manual_sigma_rad: float = 0.0
    """Noise of manual bearings."""


# Variances per metre driven and radian turned (Thrun, Burgard & Fox 2005): 10 % of the distance,
# 1.3 degrees a metre, 8 % of a turn.
PAPER_MOTION = MotionNoise(0.10**2, 0.0, 0.023**2, 0.08**2)
# A fifth of every sigma: P grows so slowly that the gate's lock-out lasts.
OVERCONFIDENT_MOTION = MotionNoise(0.02**2, 0.0, 0.0046**2, 0.016**2)


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Parameters of an extended Kalman filter."""

    name: str
    title: str

    initial_sigma_m: float = 0.0
    """Standard deviation of the start position in P0; 0 in the paper."""

    initial_sigma_rad: float = 0.0
    """Standard deviation of the start heading in P0; 0 in the paper."""

    has_recovery: bool = False
    """Whether the covariance is widened after five steps that rejected all measurements."""

    range_sigma_m: float = 0.40
    """Measurement noise of ranges, R of Eq. 6."""

    bearing_sigma_rad: float = math.radians(2.5)
    """Measurement noise of bearings, R of Eq. 6."""

    motion_noise: MotionNoise = PAPER_MOTION
    gate: ValidationGate = PAPER_GATE


# Farther landmarks are a few pixels wide; neither set-up uses these.
MAX_RANGE_M = 2.5

SIM = ExperimentSetup(
    name="sim",
    title="Simulated setting: counter-clockwise, landmarks by colour classifier",
    robot_file="p2at_omni_sim.ini",
    route=counter_clockwise_route(),
    measurement_source=MeasurementSource.DETECTOR,
    initial_heading_error_rad=math.radians(1.0),
)
REAL = ExperimentSetup(
    name="real",
    title="Real setting: clockwise, landmarks by hand, odometry with a strong deviation",
    robot_file="p2at_omni_scout.ini",
    route=clockwise_route(),
    measurement_source=MeasurementSource.MANUAL,
    # Two sigmas of R's bearings: with P0 = 0 this alone brings landmarks near the gate's limit.
    initial_heading_error_rad=math.radians(-5.2),
    manual_sigma_px=1.0,
    manual_sigma_rad=math.radians(1.0),
)
SETUPS = (SIM, REAL)

# Names are keys of summary.json, titles the heads of the report's columns.
PAPER_FILTER = FilterSettings("paper", "the paper's filter: P0 = 0, validation gate")
RECOVERING_FILTER = FilterSettings("recovery", "the same with recovery", has_recovery=True)
CONSISTENT_FILTER = FilterSettings(
    "consistent",
    "a consistent one: P0 of 5 cm and 6°, R of 10 cm and 1.5°",
    initial_sigma_m=0.05,
    initial_sigma_rad=math.radians(6.0),
    range_sigma_m=0.10,
    bearing_sigma_rad=math.radians(1.5),
)
OVERCONFIDENT_FILTER = FilterSettings(
    "overconfident", "P0 = 0 and α / 25: locked out", motion_noise=OVERCONFIDENT_MOTION
)
OVERCONFIDENT_RECOVERING_FILTER = FilterSettings(
    "overconfident_recovering",
    "P0 = 0 and α / 25, with recovery",
    motion_noise=OVERCONFIDENT_MOTION,
    has_recovery=True,
)
# In the order of the report's columns.
FILTERS = (
    PAPER_FILTER,
    RECOVERING_FILTER,
    OVERCONFIDENT_FILTER,
    OVERCONFIDENT_RECOVERING_FILTER,
    CONSISTENT_FILTER,
)
