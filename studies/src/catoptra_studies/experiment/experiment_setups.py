"""The paper's two set-ups: who drives which way, how landmarks are measured, what is believed.

Both filters have the same parameters, as in the paper. The paper gives no noise level: these were
chosen so that what it reports appears (odometry above 1 m, the gate's lock-out, the re-lock near
step 23).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from catoptra_client.localization import PAPER_GATE, MotionNoise, ValidationGate
from catoptra_studies.experiment.route import Waypoint, clockwise_route, counter_clockwise_route


class MeasurementSource(Enum):
    """Where landmark measurements come from."""

    DETECTOR = "found by the colour classifier in frames received over TCP"
    MANUAL = "taken from ground truth with measurement noise, as by hand from recorded frames"


@dataclass(frozen=True, slots=True)
class ExperimentSetup:
    """One set-up. initial_heading_error_rad: of the believed start, clockwise.

    manual_sigma_px, manual_sigma_rad: noise of measurements by hand, along the image radius and of the
    bearing.
    """

    name: str
    title: str
    robot_file: str
    route: tuple[Waypoint, ...]
    measurement_source: MeasurementSource
    initial_heading_error_rad: float
    manual_sigma_px: float = 0.0
    manual_sigma_rad: float = 0.0


# Variances per metre driven and radian turned (Thrun, Burgard & Fox 2005): 10 % of the way, 1.3
# degrees a metre, 8 % of a turn.
PAPER_MOTION = MotionNoise(0.10**2, 0.0, 0.023**2, 0.08**2)
# A fifth of every sigma: P grows so slowly that the gate's lock-out lasts.
OVERCONFIDENT_MOTION = MotionNoise(0.02**2, 0.0, 0.0046**2, 0.016**2)


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """What the filter believes: motion noise, measurement noise, start, gate, recovery.

    range_sigma_m, bearing_sigma_rad: R of Eq. 6. initial_sigma_m, initial_sigma_rad: of P0; 0 in the
    paper.
    """

    name: str
    title: str
    initial_sigma_m: float = 0.0
    initial_sigma_rad: float = 0.0
    has_recovery: bool = False
    range_sigma_m: float = 0.40
    bearing_sigma_rad: float = math.radians(2.5)
    motion_noise: MotionNoise = PAPER_MOTION
    gate: ValidationGate = PAPER_GATE


# Landmarks farther than this are a few pixels wide: not used, in either set-up.
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
    initial_heading_error_rad=math.radians(-5.2),
    manual_sigma_px=1.0,
    manual_sigma_rad=math.radians(1.0),
)
SETUPS = (SIM, REAL)

PAPER_FILTER = FilterSettings("paper", "the paper's filter: P0 = 0, validation gate")
RECOVERING_FILTER = FilterSettings("recovery", "the same with recovery", has_recovery=True)
CONSISTENT_FILTER = FilterSettings(
    "honest",
    "an honest one: P0 of 5 cm and 6°, R of 10 cm and 1.5°",
    initial_sigma_m=0.05,
    initial_sigma_rad=math.radians(6.0),
    range_sigma_m=0.10,
    bearing_sigma_rad=math.radians(1.5),
)
OVERCONFIDENT_FILTER = FilterSettings(
    "locked_out", "P0 = 0 and α / 25: locked out", motion_noise=OVERCONFIDENT_MOTION
)
OVERCONFIDENT_RECOVERING_FILTER = FilterSettings(
    "unlocked",
    "P0 = 0 and α / 25, with recovery",
    motion_noise=OVERCONFIDENT_MOTION,
    has_recovery=True,
)
FILTERS = (
    PAPER_FILTER,
    RECOVERING_FILTER,
    OVERCONFIDENT_FILTER,
    OVERCONFIDENT_RECOVERING_FILTER,
    CONSISTENT_FILTER,
)
