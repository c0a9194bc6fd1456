"""The report: one HTML file with its pictures inside, every number of it also in summary.json."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any


@dataclass(frozen=True, slots=True)
class ReportFigure:
    """A PNG file with its caption."""

    file: str
    title: str
    caption: str
    alt: str


@dataclass(frozen=True, slots=True)
class Claim:
    """One statement of the experiment: what was expected, what was measured, whether it holds."""

    text: str
    measurement: str
    is_confirmed: bool


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
    """Write folder/report.html from pictures that lie in the folder; return its path."""
    template = resources.files("catoptra_studies.experiment").joinpath("report.html")
    text = Template(template.read_text(encoding="utf-8")).substitute(
        subtitle=html.escape(subtitle),
        runs=num_runs,
        claims=_claim_table(claims),
        camera_figures=_figure_elements(folder, camera_figures),
        landmark_figures=_figure_elements(folder, landmark_figures),
        drive_figures=_figure_elements(folder, drive_figures),
        measurement_table=_measurement_table(summary["setups"]),
        filter_tables=_filter_tables(summary["setups"]),
        timing=html.escape(timing),
    )
    report = folder / "report.html"
    report.write_text(text, encoding="utf-8")
    return report


def _figure_elements(folder: Path, figures: Sequence[ReportFigure]) -> str:
    return "\n".join(_figure_element(folder, picture) for picture in figures)


def _figure_element(folder: Path, figure: ReportFigure) -> str:
    data = base64.b64encode((folder / figure.file).read_bytes()).decode()
    return (
        f'<figure><img alt="{html.escape(figure.alt)}" src="data:image/png;base64,{data}">'
        f"<figcaption><strong>{html.escape(figure.title)}.</strong> "
        f"{html.escape(figure.caption)}</figcaption></figure>"
    )


def _claim_table(claims: Sequence[Claim]) -> str:
    rows = "".join(
        f"<tr><td>{html.escape(claim.text)}</td><td>{html.escape(claim.measurement)}</td>"
        f'<td class="{"yes" if claim.is_confirmed else "no"}">{"yes" if claim.is_confirmed else "no"}</td></tr>'
        for claim in claims
    )
    return f"<table><tr><th>Claim</th><th>Measured</th><th>Holds</th></tr>{rows}</table>"


_METRIC_LABELS = {
    "odometry_max_m": "largest odometry error, m",
    "odometry_steps_above_1m": "steps with odometry error above 1 m",
    "ekf_max_m": "largest EKF error, m",
    "ekf_mean_m": "mean EKF error, m",
    "ekf_mean_on_diagonal_m": "mean EKF error on the diagonal, m",
    "ekf_max_after_step_30_m": "largest EKF error after step 30, m",
    "accepted_steps_1_to_8": "share of seen landmarks accepted, steps 1 to 8",
    "accepted_steps_9_to_22": "the same, steps 9 to 22: up to the first corner",
    "accepted_steps_23_to_40": "the same, steps 23 to 40",
    "accepted_steps_41_to_100": "the same, steps 41 to 100",
    "relock_step": "first accepting step after five that rejected all, where there was one",
    "longest_rejection_streak": "longest run of rejecting steps",
    "windowed_nis_max": "largest NIS of 20 measurements, a degree of freedom; 1 is healthy",
    "ekf_worse_in_first_5_steps": "runs with EKF worse than odometry in steps 1 to 5",
}


def _filter_tables(setups: Mapping[str, Any]) -> str:
    return "".join(_filter_table(setup) for setup in setups.values())


def _filter_table(setup: Mapping[str, Any]) -> str:
    filters = setup["filters"]
    head = "".join(f'<th class="n">{html.escape(f["title"])}</th>' for f in filters.values())
    rows = "".join(
        f"<tr><td>{name}</td>"
        + "".join(
            f'<td class="n">{_format_statistics(f["spread"][key])}</td>' for f in filters.values()
        )
        + "</tr>"
        for key, name in _METRIC_LABELS.items()
    )
    title = html.escape(setup["title"])
    return f"<h3>{title}</h3><table><tr><th></th>{head}</tr>{rows}</table>"


def _format_statistics(statistics: Mapping[str, float] | None) -> str:
    if statistics is None:
        return "none"
    return f"{statistics['median']:.3g} [{statistics['low']:.3g}, {statistics['high']:.3g}]"


def _measurement_table(setups: Mapping[str, Any]) -> str:
    rows = "".join(_measurement_row(name, s["measurements"]) for name, s in setups.items())
    return (
        "<table><tr><th>Set-up</th><th class='n'>measurements</th>"
        "<th class='n'>range error, rms</th><th class='n'>bearing error, rms</th>"
        f"<th>beacons measured, by distance</th></tr>{rows}</table>"
    )


def _measurement_row(name: str, metrics: Mapping[str, Any]) -> str:
    shares = ", ".join(
        f"{row['from_m']:g}-{row['to_m']:g} m: {row['share']:.0%}"
        for row in metrics["beacons_measured_by_distance"]
    )
    range_ = _format_rms(metrics["range_error_m"], scale=1e3, unit="mm", decimals=0)
    bearing = _format_rms(metrics["bearing_error_deg"], scale=1.0, unit="°", decimals=2)
    return (
        f"<tr><td>{html.escape(name)}</td><td class='n'>{metrics['measurements']}</td>"
        f"<td class='n'>{range_}</td><td class='n'>{bearing}</td><td>{shares}</td></tr>"
    )


def _format_rms(quantiles: Mapping[str, float], *, scale: float, unit: str, decimals: int) -> str:
    return f"{scale * quantiles['rms']:.{decimals}f} {unit}" if quantiles else "none"
