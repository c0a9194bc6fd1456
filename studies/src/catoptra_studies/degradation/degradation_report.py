"""The study's results as JSON and as a page of Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from catoptra_studies.degradation.degradation_metrics import DegradationMetrics
from catoptra_studies.degradation.degradation_study import (
    TRAINED_ON_CLEAN,
    TRAINED_ON_DEGRADED,
    LevelResult,
    SweepResult,
)
from catoptra_studies.degradation.example_frame import rms_difference
from catoptra_studies.degradation.failure_levels import FailureLevels, find_failure_levels

_REPORT_HEADER = """\
# What degraded images do to colour classification

Written by `make effects`. {runs} drives of {frames} frames a rung, the same seeds everywhere. A
beacon counts as found within 5° of its bearing, of those that the stream calls visible within
2.5 m. The filter is the paper's; its errors are medians over the drives. The classifier has
learnt from clean pictures, as the paper's; "taught anew": from pictures as bad as those it is
shown. "Grey levels": how far a picture is from the clean one of the same place, rms. Odometry
alone comes to be {odometry:.2f} m off.
"""
_LEVEL_HEADER = (
    *("grey levels", "found", "false a frame", "bearing", "range", "EKF largest", "EKF final"),
    *("taught anew: found", "false a frame", "EKF largest"),
)


def failure_levels_by_training(result: SweepResult) -> dict[str, FailureLevels]:
    """Return a ladder's verdict by what the classifier had learnt from."""
    clean = result.clean.metrics[TRAINED_ON_CLEAN]
    return {
        learnt: find_failure_levels(
            clean, [(rung.label, rung.metrics[learnt]) for rung in result.levels]
        )
        for learnt in (TRAINED_ON_CLEAN, TRAINED_ON_DEGRADED)
    }


def summarise_degradation(
    results: Sequence[SweepResult], *, num_runs: int, seed: int
) -> dict[str, Any]:
    """Return all that degraded.json holds."""
    return {
        "version": 1,
        "runs": num_runs,
        "seed": seed,
        "ladders": [_summarise_sweep(r) for r in results],
    }


def _summarise_sweep(result: SweepResult) -> dict[str, Any]:
    ladder = result.sweep
    return {
        "name": ladder.name,
        "words": ladder.description,
        "unit": ladder.unit,
        "keys": ladder.ini_keys.split("|") if ladder.ini_keys else [],
        "clean": _summarise_level(result.clean, result),
        "rungs": [
            {**_summarise_level(measured, result), "keys": rung.ini_keys.split("|")}
            for measured, rung in zip(result.levels, ladder.levels, strict=True)
        ],
        "verdicts": {learnt: asdict(v) for learnt, v in failure_levels_by_training(result).items()},
    }


def _summarise_level(level: LevelResult, result: SweepResult) -> dict[str, Any]:
    told = {learnt: {**asdict(f), "rate": f.detection_rate} for learnt, f in level.metrics.items()}
    return {
        "label": level.label,
        "changed_grey_levels": _rms_difference(level, result),
        "taught": told,
    }


def _rms_difference(level: LevelResult, result: SweepResult) -> float:
    return rms_difference(level.example, result.clean.example)


def format_degradation_report(results: Sequence[SweepResult], *, num_runs: int) -> str:
    """Return the page: verdicts first, then each ladder's rungs."""
    clean = results[0].clean.metrics[TRAINED_ON_CLEAN]
    head = _REPORT_HEADER.format(
        runs=num_runs, frames=clean.num_frames // num_runs, odometry=clean.odometry_max_m
    )
    tables = (line for result in results for line in _level_table(result))
    return "\n".join([head, *failure_table(results), *tables]) + "\n"


def failure_table(results: Sequence[SweepResult]) -> Iterator[str]:
    """Yield the table's lines: at which rung each ladder starts to fail."""
    yield from _table_row("ladder", "unit", "rungs", "found < 90 %", "< 50 %", "EKF > 2x", "> 0.6 m",
                    "taught anew: < 90 %", "< 50 %", "> 0.6 m")  # fmt: skip
    yield from _table_row(*["---"] * 10)
    for result in results:
        taught = failure_levels_by_training(result)
        clean, anew = taught[TRAINED_ON_CLEAN], taught[TRAINED_ON_DEGRADED]
        happens = (
            clean.detection_below_90_percent,
            clean.detection_below_50_percent,
            clean.ekf_error_above_twice_clean,
            clean.ekf_error_above_paper,
        )
        again = (
            anew.detection_below_90_percent,
            anew.detection_below_50_percent,
            anew.ekf_error_above_paper,
        )
        yield from _table_row(
            result.sweep.name,
            result.sweep.unit,
            f"{result.levels[0].label} … {result.levels[-1].label}",
            *(label or "–" for label in (*happens, *again)),
        )


def _level_table(result: SweepResult) -> Iterator[str]:
    ladder = result.sweep
    yield from (
        "",
        f"## {ladder.name}",
        "",
        f"{ladder.description[0].upper()}{ladder.description[1:]}.",
        "",
    )
    yield from _table_row(ladder.unit, *_LEVEL_HEADER)
    yield from _table_row(*["---"] * (1 + len(_LEVEL_HEADER)))
    for rung in (result.clean, *result.levels):
        taught = rung.metrics[TRAINED_ON_CLEAN]
        anew = rung.metrics.get(TRAINED_ON_DEGRADED, taught)
        level = f"{_rms_difference(rung, result):.1f}"
        yield from _table_row(rung.label, level, *_metric_cells(taught), *_short_cells(anew))


def _metric_cells(metrics: DegradationMetrics) -> tuple[str, ...]:
    bearing = "–" if metrics.bearing_rms_deg is None else f"{metrics.bearing_rms_deg:.2f}°"
    range_ = "–" if metrics.range_rms_m is None else f"{1e3 * metrics.range_rms_m:.0f} mm"
    found, false, largest = _short_cells(metrics)
    return found, false, bearing, range_, largest, f"{metrics.ekf_final_m:.2f} m"


def _short_cells(metrics: DegradationMetrics) -> tuple[str, str, str]:
    return (
        f"{metrics.detection_rate:.0%}",
        f"{metrics.false_per_frame:.2f}",
        f"{metrics.ekf_max_m:.2f} m",
    )


def _table_row(*cells: str) -> Iterator[str]:
    yield f"| {' | '.join(cells)} |"
