"""The experiment's own numbers, which the paper does not give, as a table of the report."""

from __future__ import annotations

import math

from catoptra_client.localization import MotionNoise
from catoptra_studies.experiment.experiment_setups import (
    CONSISTENT_FILTER,
    MAX_RANGE_M,
    OVERCONFIDENT_MOTION,
    PAPER_FILTER,
    PAPER_MOTION,
    REAL,
    SIM,
    ExperimentSetup,
    FilterSettings,
)
from catoptra_studies.reports.html_page import Cell, html_table

# Keys of [USARBot.OdometrySensor] in both robot files: text of the table, and what they are for.
ODOMETRY_ERRORS = {
    "sim": {"TurnScale": 0.94, "DriftPerMetre": 0.0218},
    "real": {"DistanceScale": 1.02, "DriftPerMetre": -0.0201},
}


def parameter_table() -> str:
    """HTML table of every number that was chosen so that the paper's behaviour appears."""
    rows = [
        ("error of the believed heading at the start, clockwise", _describe_start()),
        ("odometry of sim: errors beside the slip of the wheels", _describe_odometry("sim")),
        ("odometry of real: a strong deviation to the left", _describe_odometry("real")),
        ("noise of measurements by hand (real)", _describe_manual_noise(REAL)),
        ("farthest landmark that is measured", f"{MAX_RANGE_M:g} m"),
        ("R of the paper's filter", _describe_measurement_noise(PAPER_FILTER)),
        ("motion noise of the paper's filter", _describe_motion(PAPER_MOTION)),
        ("motion noise of the overconfident filter", _describe_motion(OVERCONFIDENT_MOTION)),
        ("P0 and R of the consistent filter", _describe_consistent(CONSISTENT_FILTER)),
    ]
    header = [Cell("Chosen here, since the paper does not give it"), Cell("Value")]
    return html_table(header, [[Cell(name), Cell(value)] for name, value in rows])


def _describe_start() -> str:
    sim, real = (math.degrees(setup.initial_heading_error_rad) for setup in (SIM, REAL))
    return f"sim {sim:.1f}°, real {real:.1f}°".replace("-", "−")


def _describe_odometry(setup: str) -> str:
    errors = ODOMETRY_ERRORS[setup]
    drift_deg = math.degrees(errors["DriftPerMetre"])
    parts = [f"turns its heading by {drift_deg:+.2f}° a metre, clockwise".replace("-", "−")]
    if "TurnScale" in errors:
        parts.append(f"reports {errors['TurnScale']:.0%} of a turn by the wheels")
    if "DistanceScale" in errors:
        parts.append(f"reports {errors['DistanceScale']:.0%} of the distance")
    return "; ".join(parts)


def _describe_manual_noise(setup: ExperimentSetup) -> str:
    bearing_deg = math.degrees(setup.manual_sigma_rad)
    return f"{setup.manual_sigma_px:g} px of the image radius, {bearing_deg:.1f}° of the bearing"


def _describe_measurement_noise(settings: FilterSettings) -> str:
    bearing_deg = math.degrees(settings.bearing_sigma_rad)
    return f"{settings.range_sigma_m:.2f} m of the range, {bearing_deg:.1f}° of the bearing"


def _describe_motion(noise: MotionNoise) -> str:
    # Standard deviations; alpha2 is zero in all filters.
    distance, turn = math.sqrt(noise.alpha1), math.sqrt(noise.alpha4)
    heading_deg = math.degrees(math.sqrt(noise.alpha3))
    return f"{distance:.0%} of the distance, {heading_deg:.2f}° a metre, {turn:.1%} of a turn"


def _describe_consistent(settings: FilterSettings) -> str:
    heading_deg = math.degrees(settings.initial_sigma_rad)
    start = f"{1e2 * settings.initial_sigma_m:.0f} cm and {heading_deg:.0f}°"
    return f"P0 of {start}; R of {_describe_measurement_noise(settings)}"
