"""The report's section on detection and localization with the frames of each level."""

from __future__ import annotations

from catoptra_studies.accuracy_cost.cost_results import CostResults, LocalizationAccuracy
from catoptra_studies.reports import markdown_table, wrap_paragraph


def format_localization(results: CostResults) -> str:
    """The section as Markdown; empty where no robot was driven."""
    localization = results.localization
    if localization is None:
        return ""
    # Times come from the levels: the drives run in real processes and measure none of their own.
    times_ms = {level.name: level.wall_ms for level in results.levels}
    rows = [
        [
            row.level,
            f"{times_ms[row.level]:.1f}" if row.level in times_ms else "-",
            f"{row.near_detection_rate:.0%}",
            f"{row.detection_rate:.0%}",
            f"{row.bearing_rms_deg:.2f}",
            f"{row.range_rms_m:.3f}",
            f"{row.ekf_mean_m:.3f}",
            f"{row.ekf_max_m:.2f}",
            f"{row.consistent_ekf_mean_m:.3f}",
            f"{row.consistent_ekf_max_m:.2f}",
        ]
        for row in localization.rows
    ]
    header = (
        *("level", "ms", "found to 1.5 m", "to 2.5 m", "bearing deg", "range m"),
        *("filter mean m", "max m", "consistent mean m", "max m"),
    )
    return f"""\
## Landmarks and localization

{markdown_table(header, rows)}

{wrap_paragraph(_describe_conditions(localization))}

{wrap_paragraph(_describe_sufficient_level(localization))}

`localization.png`."""


def _describe_conditions(localization: LocalizationAccuracy) -> str:
    return (
        "The key levels only, each through a server process of its own: "
        f"{localization.num_runs} runs of {localization.steps_per_run} steps round the field, the "
        "same seeds for all, frames over TCP, one colour classifier trained on frames of the best "
        "level. Found: the fraction of beacons within reach that were measured. Bearing and "
        "range: rms over all measurements. Filter: the position error of the paper's (P0 = 0) and "
        "of a consistent one, whose covariances match the real errors of start and "
        "measurements, medians over the runs of a run's mean and largest. Odometry alone: up to "
        f"{localization.odometry_max_m:.2f} m."
    )


def _describe_sufficient_level(localization: LocalizationAccuracy) -> str:
    """Sentence about the coarsest level that localizes as well as the best, to a centimetre."""
    # Evaluated by the consistent filter, since its R is nearer the real errors of the measurements.
    best_m = min(row.consistent_ekf_mean_m for row in localization.rows)
    sufficient = next(
        row for row in localization.rows if row.consistent_ekf_mean_m <= best_m + 0.01
    )
    return (
        f"To localize within a centimetre of the best, {sufficient.level} is enough: the filter "
        f"averages over bearings that are {sufficient.bearing_rms_deg:.2g} deg off."
    )
