"""The experiment's report: one HTML file with its figures inside.

Every number of the report is also in summary.json.
"""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

from catoptra_studies.experiment.paper_claims import Claim
from catoptra_studies.reports.html_page import Cell, ReportFigure, figure_elements, html_table

# Key of a run's metrics and its label in the report, in the order of the rows.
_METRIC_LABELS = {
    "odometry_max_m": "largest odometry error, m",
    "odometry_steps_above_1m": "steps with odometry error above 1 m",
    "ekf_max_m": "largest EKF error, m",
    "ekf_mean_m": "mean EKF error, m",
    "ekf_mean_on_diagonal_m": "mean EKF error on the diagonal, m",
    "ekf_max_after_step_30_m": "largest EKF error after step 30, m",
    "accepted_steps_1_to_8": "fraction of measured landmarks accepted, steps 1 to 8",
    "accepted_steps_9_to_22": "the same, steps 9 to 22: up to the first corner",
    "accepted_steps_23_to_40": "the same, steps 23 to 40",
    "accepted_steps_41_to_100": "the same, steps 41 to 100",
    "relock_step": "first accepting step after five that rejected all, where there was one",
    "longest_rejection_streak": "longest run of rejecting steps",
    "windowed_nis_max": "largest NIS of 20 measurements, a degree of freedom; 1 is consistent",
    "ekf_worse_in_first_5_steps": "runs with EKF worse than odometry in steps 1 to 5",
}


def write_html_report(
    folder: Path,
    *,
    subtitle: str,
    num_runs: int,
    claims: Sequence[Claim],
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
        claims=_claim_table(claims),
        camera_figures=figure_elements(folder, camera_figures),
        landmark_figures=figure_elements(folder, landmark_figures),
        drive_figures=figure_elements(folder, drive_figures),
        measurement_table=_measurement_table(summary["setups"]),
        filter_tables=_filter_tables(summary["setups"]),
        timing=html.escape(timing),
    )
    report = folder / "report.html"
    report.write_text(text, encoding="utf-8")
    return report


def _claim_table(claims: Sequence[Claim]) -> str:
    rows = []
    for claim in claims:
        answer = "yes" if claim.is_confirmed else "no"
        rows.append([Cell(claim.text), Cell(claim.measurement), Cell(answer, answer)])
    return html_table([Cell("Claim"), Cell("Measured"), Cell("Confirmed")], rows)


def _filter_tables(setups: Mapping[str, Any]) -> str:
    return "".join(_filter_table(setup) for setup in setups.values())


def _filter_table(setup: Mapping[str, Any]) -> str:
    # Filters are the columns, so that a metric can be read across all of them.
    filters = setup["filters"].values()
    header = [Cell(""), *(Cell(settings["title"], "n") for settings in filters)]
    rows = [
        [Cell(label), *(Cell(_format_statistics(f["statistics"][key]), "n") for f in filters)]
        for key, label in _METRIC_LABELS.items()
    ]
    return f"<h3>{html.escape(setup['title'])}</h3>{html_table(header, rows)}"


def _format_statistics(statistics: Mapping[str, float] | None) -> str:
    if statistics is None:
        return "none"
    return f"{statistics['median']:.3g} [{statistics['p05']:.3g}, {statistics['p95']:.3g}]"


def _measurement_table(setups: Mapping[str, Any]) -> str:
    header = [
        Cell("Set-up"),
        *(Cell(title, "n") for title in ("measurements", "range error, rms", "bearing error, rms")),
        Cell("beacons measured, by distance"),
    ]
    rows = [_measurement_row(name, setup["measurements"]) for name, setup in setups.items()]
    return html_table(header, rows)


def _measurement_row(name: str, metrics: Mapping[str, Any]) -> list[Cell]:
    # Distances without any beacon are left out, not shown as zero.
    rates = ", ".join(
        f"{row['from_m']:g}-{row['to_m']:g} m: {row['rate']:.0%}"
        for row in metrics["beacons_measured_by_distance"]
    )
    # Millimetres: ranges are good to some ten of them.
    range_ = _format_rms(metrics["range_error_m"], scale=1e3, unit="mm", decimals=0)
    bearing = _format_rms(metrics["bearing_error_deg"], scale=1.0, unit="°", decimals=2)
    numbers = (str(metrics["measurements"]), range_, bearing)
    return [Cell(name), *(Cell(number, "n") for number in numbers), Cell(rates)]


def _format_rms(quantiles: Mapping[str, float], *, scale: float, unit: str, decimals: int) -> str:
    return f"{scale * quantiles['rms']:.{decimals}f} {unit}" if quantiles else "none"
