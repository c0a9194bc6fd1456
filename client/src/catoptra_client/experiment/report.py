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
class Picture:
    """A PNG file with its caption."""

    file: str
    title: str
    caption: str
    alt: str


@dataclass(frozen=True, slots=True)
class Claim:
    """One statement of the experiment: what was expected, what was measured, whether it holds."""

    text: str
    measured: str
    holds: bool


def write_report(
    folder: Path,
    *,
    subtitle: str,
    runs: int,
    claims: Sequence[Claim],
    camera: Sequence[Picture],
    landmarks: Sequence[Picture],
    drive: Sequence[Picture],
    summary: Mapping[str, Any],
    timing: str,
) -> Path:
    """Write folder/report.html from pictures that lie in the folder; return its path."""
    template = resources.files("catoptra_client.experiment").joinpath("report.html")
    text = Template(template.read_text(encoding="utf-8")).substitute(
        subtitle=html.escape(subtitle),
        runs=runs,
        claims=_claims_table(claims),
        camera_figures=_figures(folder, camera),
        landmark_figures=_figures(folder, landmarks),
        drive_figures=_figures(folder, drive),
        measurement_table=_measurement_table(summary["setups"]),
        filter_tables=_filter_tables(summary["setups"]),
        timing=html.escape(timing),
    )
    report = folder / "report.html"
    report.write_text(text, encoding="utf-8")
    return report


def _figures(folder: Path, pictures: Sequence[Picture]) -> str:
    return "\n".join(_figure(folder, picture) for picture in pictures)


def _figure(folder: Path, picture: Picture) -> str:
    data = base64.b64encode((folder / picture.file).read_bytes()).decode()
    return (
        f'<figure><img alt="{html.escape(picture.alt)}" src="data:image/png;base64,{data}">'
        f"<figcaption><strong>{html.escape(picture.title)}.</strong> "
        f"{html.escape(picture.caption)}</figcaption></figure>"
    )


def _claims_table(claims: Sequence[Claim]) -> str:
    rows = "".join(
        f"<tr><td>{html.escape(claim.text)}</td><td>{html.escape(claim.measured)}</td>"
        f'<td class="{"yes" if claim.holds else "no"}">{"yes" if claim.holds else "no"}</td></tr>'
        for claim in claims
    )
    return f"<table><tr><th>Claim</th><th>Measured</th><th>Holds</th></tr>{rows}</table>"


_FIGURE_NAMES = {
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
        + "".join(f'<td class="n">{_spread(f["spread"][key])}</td>' for f in filters.values())
        + "</tr>"
        for key, name in _FIGURE_NAMES.items()
    )
    title = html.escape(setup["title"])
    return f"<h3>{title}</h3><table><tr><th></th>{head}</tr>{rows}</table>"


def _spread(spread: Mapping[str, float] | None) -> str:
    if spread is None:
        return "none"
    return f"{spread['median']:.3g} [{spread['low']:.3g}, {spread['high']:.3g}]"


def _measurement_table(setups: Mapping[str, Any]) -> str:
    rows = "".join(_measurement_row(name, s["measurements"]) for name, s in setups.items())
    return (
        "<table><tr><th>Set-up</th><th class='n'>measurements</th>"
        "<th class='n'>range error, rms</th><th class='n'>bearing error, rms</th>"
        f"<th>beacons measured, by distance</th></tr>{rows}</table>"
    )


def _measurement_row(name: str, measured: Mapping[str, Any]) -> str:
    shares = ", ".join(
        f"{row['from_m']:g}-{row['to_m']:g} m: {row['share']:.0%}"
        for row in measured["beacons_measured_by_distance"]
    )
    range_ = _rms(measured["range_error_m"], scale=1e3, unit="mm", decimals=0)
    bearing = _rms(measured["bearing_error_deg"], scale=1.0, unit="°", decimals=2)
    return (
        f"<tr><td>{html.escape(name)}</td><td class='n'>{measured['measurements']}</td>"
        f"<td class='n'>{range_}</td><td class='n'>{bearing}</td><td>{shares}</td></tr>"
    )


def _rms(quantiles: Mapping[str, float], *, scale: float, unit: str, decimals: int) -> str:
    return f"{scale * quantiles['rms']:.{decimals}f} {unit}" if quantiles else "none"
