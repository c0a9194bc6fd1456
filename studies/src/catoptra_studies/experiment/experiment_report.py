"""The experiment's report: one HTML file with all figures inside.

Every number of a drive is also in summary.json. The table of parameters has the numbers that the
paper does not give and that were chosen here.
"""

from __future__ import annotations

import html
import math
from collections.abc import Mapping, Sequence
from datetime import date
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

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
from catoptra_studies.experiment.paper_claims import Claim, Difference
from catoptra_studies.reports import (
    Cell,
    ReportFigure,
    figure_elements,
    html_table,
    markdown_table,
)

# Keys of [USARBot.OdometrySensor] in both robot files: text of the table, and the purpose.
ODOMETRY_ERRORS = {
    "sim": {"TurnScale": 0.94, "DriftPerMetre": 0.0218},
    "real": {"DistanceScale": 1.02, "DriftPerMetre": -0.0201},
}


# Keys of a run's metrics, and labels in the report, in the order of the rows. Each column of the
# table is one filter; odometry is the same in all.
_METRIC_LABELS = {
    "odometry_max_m": "odometry alone: largest error, m",
    "odometry_steps_above_1m": "odometry alone: steps with an error above 1 m",
    "ekf_max_m": "this filter: largest error, m",
    "ekf_mean_m": "this filter: mean error, m",
    "ekf_mean_steps_9_to_23_m": "mean error in steps 9 to 23, before the first corner, m",
    "ekf_mean_steps_31_to_60_m": "mean error in steps 31 to 60, m",
    "ekf_max_steps_61_to_84_m": "largest error in steps 61 to 84, on the way back, m",
    "ekf_mean_on_diagonal_m": "mean error on the diagonal, m",
    "ekf_worse_in_first_5_steps": "1 where it is worse than odometry in steps 1 to 5",
    "accepts_first_measurements": "1 where it accepts a landmark in the first measuring step",
    "accepted_steps_1_to_22": "fraction of the landmarks accepted, steps 1 to 22",
    "accepted_steps_9_to_22": "the same, steps 9 to 22",
    "accepted_steps_23_to_40": "the same, steps 23 to 40, after the first corner",
    "accepted_steps_41_to_100": "the same, steps 41 to 100",
    "relock_step": "first accepting step after five that rejected all, where there was one",
    "longest_rejection_streak": "longest run of steps that rejected all",
    "fewest_landmarks_in_a_step": "fewest landmarks measured in a step",
    "windowed_nis_max": "largest NIS of 20 measurements, a degree of freedom",
}


def write_html_report(
    folder: Path,
    *,
    subtitle: str,
    num_runs: int,
    claims: Sequence[Claim],
    differences: Sequence[Difference],
    camera_figures: Sequence[ReportFigure],
    landmark_figures: Sequence[ReportFigure],
    drive_figures: Sequence[ReportFigure],
    summary: Mapping[str, Any],
    timing: str,
) -> Path:
    """Write report.html.

    Args:
        folder: Folder for the report, with the PNG files of all figures.
        subtitle: Line below the title.
        num_runs: Drives of each set-up.
        claims: Claims of the paper with their evaluation.
        differences: Findings of the paper that were not reproduced.
        camera_figures: Figures of the first section.
        landmark_figures: Figures of the second section.
        drive_figures: Figures of the third section.
        summary: Content of summary.json, of which `setups` is used.
        timing: Last line.

    Returns:
        Path of the report.
    """
    template = resources.files("catoptra_studies.experiment").joinpath("report.html")
    # substitute and not safe_substitute: a mark of the template that stays empty has to fail.
    text = Template(template.read_text(encoding="utf-8")).substitute(
        subtitle=html.escape(subtitle),
        num_runs=num_runs,
        gate=f"{1.0 - PAPER_FILTER.gate.false_rejection_rate:.0%}",
        claims=_claim_table(claims),
        differences=_difference_table(differences),
        parameters=_parameter_table(),
        camera_figures=figure_elements(folder, camera_figures),
        landmark_figures=figure_elements(folder, landmark_figures),
        drive_figures=figure_elements(folder, drive_figures),
        measurement_table=_measurement_table(summary["setups"]),
        filter_tables="".join(map(_filter_table, summary["setups"].values())),
        timing=html.escape(timing),
    )
    report = folder / "report.html"
    report.write_text(text, encoding="utf-8")
    return report


def _claim_table(claims: Sequence[Claim]) -> str:
    rows: list[list[Cell | str]] = []
    for claim in claims:
        # A class of neither verdict has no colour.
        answer = Cell(claim.verdict, claim.verdict.partition(" ")[0])
        rows.append([claim.text, claim.criterion, str(claim.runs), answer])
    return html_table(("Claim", "A run satisfies it where", "Satisfied in", "Confirmed"), rows)


def _difference_table(differences: Sequence[Difference]) -> str:
    rows = [[d.paper, d.here, d.reason] for d in differences]
    return html_table(("The paper", "Here", "Why, as far as it is known"), rows)


def _filter_table(setup: Mapping[str, Any]) -> str:
    # Filters are the columns, so that a metric can be read across all.
    filters = setup["filters"].values()
    header: list[Cell | str] = ["Filter:", *(Cell(settings["title"], "n") for settings in filters)]
    rows: list[list[Cell | str]] = [
        [label, *(Cell(_format_statistics(f["statistics"][key]), "n") for f in filters)]
        for key, label in _METRIC_LABELS.items()
    ]
    return f"<h3>{html.escape(setup['title'])}</h3>{html_table(header, rows)}"


def format_page_block(summary: Mapping[str, Any]) -> str:
    """Errors of odometry and of each filter, for a page of the repository."""
    rows, titles = [], ["set-up"]
    for name, setup in summary["setups"].items():
        filters = setup["filters"].values()
        titles[1:] = [settings["title"] for settings in filters]
        for key in ("odometry_max_m", "ekf_max_m", "ekf_mean_m"):
            cells = [_format_statistics(settings["statistics"][key]) for settings in filters]
            rows.append([f"{name}: {_METRIC_LABELS[key]}", *cells])
    extent = f"{date.today()}, seed {summary['seed']}, {summary['num_runs']} runs a set-up"
    table = markdown_table(titles, rows)
    return f"{extent}: medians, in brackets the quantiles of 5 and 95 %.\n\n{table}"


def _format_statistics(statistics: Mapping[str, float] | None) -> str:
    if statistics is None:
        return "none"
    # Wrapped between median and bracket alone: in one line the columns are wider than the page.
    return f"{statistics['median']:.3g} [{statistics['p05']:.3g},\u00a0{statistics['p95']:.3g}]"


def _measurement_table(setups: Mapping[str, Any]) -> str:
    header: list[Cell | str] = [
        "Set-up",
        *(Cell(title, "n") for title in ("measurements", "range error, rms", "bearing error, rms")),
        "beacons measured, by distance",
    ]
    rows = [_measurement_row(name, setup["measurements"]) for name, setup in setups.items()]
    return html_table(header, rows)


def _measurement_row(name: str, metrics: Mapping[str, Any]) -> list[Cell | str]:
    # Distances without any beacon are left out, not shown as zero.
    rates = ", ".join(
        f"{row['from_m']:g}-{row['to_m']:g} m: {row['rate']:.0%}"
        for row in metrics["beacons_measured_by_distance"]
    )
    # Millimetres: ranges are good to some ten of them.
    range_ = _format_rms(metrics["range_error_m"], scale=1e3, unit="mm", decimals=0)
    bearing = _format_rms(metrics["bearing_error_deg"], scale=1.0, unit="°", decimals=2)
    numbers = (str(metrics["measurements"]), range_, bearing)
    return [name, *(Cell(number, "n") for number in numbers), rates]


def _format_rms(quantiles: Mapping[str, float], *, scale: float, unit: str, decimals: int) -> str:
    return f"{scale * quantiles['rms']:.{decimals}f} {unit}" if quantiles else "none"


def _parameter_table() -> str:
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
    return html_table(("Chosen here, since the paper does not give it", "Value"), rows)


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
