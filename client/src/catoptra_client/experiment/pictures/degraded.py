"""The ladders of degraded pictures: how they look, what is found in them, what the filter errs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from catoptra_client.experiment.degraded.sample import Pixel, Sample
from catoptra_client.experiment.degraded.study import (
    FROM_CLEAN,
    FROM_SAME,
    LadderResult,
    RungResult,
)
from catoptra_client.experiment.degraded.verdict import FILTER_LIMIT_M
from catoptra_client.experiment.pictures import style

_COLUMNS = 4
_TAUGHT = (
    (FROM_CLEAN, style.REJECTED, "o-", "taught by clean pictures"),
    (FROM_SAME, style.ACCEPTED, "s--", "taught anew by such pictures"),
)


def draw_ladder(path: Path, result: LadderResult) -> None:
    """Write a ladder's page: a sample of each rung above, rate and error below."""
    rungs = (result.clean, *result.rungs)
    with style.figure(path, figsize=(2.9 * len(rungs), 6.6)) as drawing:
        above, below = drawing.subfigures(2, 1, height_ratios=(1.25, 1.0))
        above.suptitle(f"{result.ladder.name}: {result.ladder.words}\n", fontweight="bold")
        for axis, rung in zip(above.subplots(1, len(rungs)), rungs, strict=True):
            _draw_sample(axis, rung.sample)
            axis.set_title(_sample_title(rung))
        rate, error = below.subplots(1, 2)
        draw_rates(rate, result)
        draw_errors(error, result)
        for axis in (rate, error):
            axis.set_xlabel(result.ladder.unit)
        handles, labels = error.get_legend_handles_labels()
        drawing.legend(handles, labels, loc="outside lower center", ncols=3)


def draw_all(path: Path, results: Sequence[LadderResult]) -> None:
    """Write the curves of all ladders: a pair of plots each, rate above error."""
    rows = math.ceil(len(results) / _COLUMNS)
    with style.figure(path, figsize=(4.0 * _COLUMNS, 4.6 * rows)) as drawing:
        cells = drawing.subfigures(rows, _COLUMNS, squeeze=False).flat
        for cell, result in zip(cells, results, strict=False):
            rate, error = cell.subplots(2, 1, sharex=True)
            draw_rates(rate, result)
            draw_errors(error, result)
            rate.set_title(result.ladder.name)
            error.set_xlabel(result.ladder.unit)
        handles, labels = error.get_legend_handles_labels()
        drawing.legend(handles, labels, loc="outside lower center", ncols=3)


def draw_rates(axis: Any, result: LadderResult) -> None:
    """Draw the share of visible beacons that was found, by rung."""
    for learnt, colour, line, label in _TAUGHT:
        shares = [100.0 * _figures(rung, learnt).rate for rung in _rungs(result)]
        axis.plot(_labels(result), shares, line, color=colour, label=label)
    axis.set_ylim(-4, 104)
    axis.set_ylabel("beacons found, %")


def draw_errors(axis: Any, result: LadderResult) -> None:
    """Draw the filter's largest error by rung, its limit, and odometry alone."""
    for learnt, colour, line, label in _TAUGHT:
        errors = [_figures(rung, learnt).ekf_max_m for rung in _rungs(result)]
        axis.plot(_labels(result), errors, line, color=colour, label=label)
    odometry = [_figures(rung, FROM_CLEAN).odometry_max_m for rung in _rungs(result)]
    axis.plot(_labels(result), odometry, ":", color=style.ODOMETRY, label="odometry alone")
    axis.axhline(FILTER_LIMIT_M, color=style.MUTED, lw=1, ls="--")
    axis.set_ylim(bottom=0.0)
    axis.set_ylabel("EKF's largest error, m")


def _rungs(result: LadderResult) -> tuple[RungResult, ...]:
    return (result.clean, *result.rungs)


def _labels(result: LadderResult) -> list[str]:
    return [rung.label for rung in _rungs(result)]


def _figures(rung: RungResult, learnt: str) -> Any:
    return rung.figures.get(learnt, rung.figures[FROM_CLEAN])


def _sample_title(rung: RungResult) -> str:
    shown = rung.sample
    false = f", {len(shown.false_rad)} false" if shown.false_rad else ""
    return f"{rung.label}\n{len(shown.found)} of {len(shown.found) + len(shown.missed)}{false}"


def _draw_sample(axis: Any, shown: Sample) -> None:
    """Draw the frame; a ring on each beacon found, a cross on one missed, a ray to a false one."""
    axis.imshow(shown.frame)
    _mark(axis, shown.found, "o", "white")
    _mark(axis, shown.missed, "x", style.ODOMETRY)
    u, v = shown.centre_px
    for bearing in shown.false_rad:
        reach = 0.45 * shown.frame.shape[0]
        # The picture's top is forward, its right is right.
        ends = (u + reach * math.sin(bearing), v - reach * math.cos(bearing))
        axis.plot([u, ends[0]], [v, ends[1]], color=style.REJECTED, lw=1.5)
    axis.set_axis_off()


def _mark(axis: Any, places: Sequence[Pixel], marker: str, colour: str) -> None:
    if places:
        u, v = zip(*places, strict=True)
        axis.plot(u, v, marker, color=colour, ms=11, mfc="none", mew=2.0)
