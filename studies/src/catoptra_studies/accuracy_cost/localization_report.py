"""The report's part on what accuracy is worth to a robot that finds landmarks and localises."""

from __future__ import annotations

from catoptra_studies.accuracy_cost.cost_results import CostResults, LocalizationAccuracy
from catoptra_studies.reports.markdown import markdown_table, wrap_paragraph


def format_localization(results: CostResults) -> str:
    """Return the table; nothing where the client's side has not measured."""
    landmarks = results.localization
    if landmarks is None:
        return ""
    times = {step.name: step.wall_ms for step in results.levels}
    rows = [
        [row.level, f"{times[row.level]:.1f}" if row.level in times else "-", f"{row.near_detection_rate:.0%}",
         f"{row.detection_rate:.0%}", f"{row.bearing_rms_deg:.2f}", f"{row.range_rms_m:.3f}",
         f"{row.ekf_mean_m:.3f}", f"{row.ekf_max_m:.2f}",
         f"{row.consistent_ekf_mean_m:.3f}", f"{row.consistent_ekf_max_m:.2f}"]
        for row in landmarks.rows
    ]  # fmt: skip
    head = ("step", "ms", "found to 1.5 m", "to 2.5 m", "bearing deg", "range m",
            "filter mean m", "max m", "honest mean m", "max m")  # fmt: skip
    return f"""\
## What it is worth: landmarks and localisation

{markdown_table(head, rows)}

{wrap_paragraph(_describe_conditions(landmarks))}

{wrap_paragraph(_describe_sufficient_level(landmarks))}

`landmarks.png`."""


def _describe_conditions(localization: LocalizationAccuracy) -> str:
    return (
        f"The key steps only, each through a server process of its own: {localization.num_runs} runs of "
        f"{localization.steps_per_run} steps round the field, the same seeds for all, frames over TCP, "
        "one colour classifier trained on frames of the best step. Found: the share of beacons "
        "within reach that were measured. Bearing and range: rms over all measurements. Filter: "
        "the position error of the paper's (P0 = 0) and of one that states its start and its "
        "noises honestly, medians over the runs of a run's mean and largest. Odometry alone: up to "
        f"{localization.odometry_max_m:.2f} m."
    )


def _describe_sufficient_level(localization: LocalizationAccuracy) -> str:
    """Return the coarsest step that localises as well as the best, to a centimetre."""
    best = min(row.consistent_ekf_mean_m for row in localization.rows)
    enough = next(row for row in localization.rows if row.consistent_ekf_mean_m <= best + 0.01)
    return (
        f"To localise within a centimetre of the best, {enough.level} is enough: the filter "
        f"averages over bearings that are {enough.bearing_rms_deg:.2g} deg off."
    )
