"""The study's results as JSON and as a page of Markdown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from catoptra_client.experiment.degraded.measures import Figures
from catoptra_client.experiment.degraded.sample import changed
from catoptra_client.experiment.degraded.study import (
    FROM_CLEAN,
    FROM_SAME,
    LadderResult,
    RungResult,
)
from catoptra_client.experiment.degraded.verdict import Verdict, verdict

_HEAD = """\
# What degraded images do to colour classification

Written by `make effects`. {runs} drives of {frames} frames a rung, the same seeds everywhere. A
beacon counts as found within 5° of its bearing, of those that the stream calls visible within
2.5 m. The filter is the paper's; its errors are medians over the drives. The classifier has
learnt from clean pictures, as the paper's; "taught anew": from pictures as bad as those it is
shown. "Grey levels": how far a picture is from the clean one of the same place, rms. Odometry
alone comes to be {odometry:.2f} m off.
"""
_RUNG_HEAD = (
    *("grey levels", "found", "false a frame", "bearing", "range", "EKF largest", "EKF final"),
    *("taught anew: found", "false a frame", "EKF largest"),
)


def verdicts(result: LadderResult) -> dict[str, Verdict]:
    """Return a ladder's verdict by what the classifier had learnt from."""
    clean = result.clean.figures[FROM_CLEAN]
    return {
        learnt: verdict(clean, [(rung.label, rung.figures[learnt]) for rung in result.rungs])
        for learnt in (FROM_CLEAN, FROM_SAME)
    }


def document(results: Sequence[LadderResult], *, runs: int, seed: int) -> dict[str, Any]:
    """Return all that degraded.json holds."""
    return {"version": 1, "runs": runs, "seed": seed, "ladders": [_ladder(r) for r in results]}


def _ladder(result: LadderResult) -> dict[str, Any]:
    ladder = result.ladder
    return {
        "name": ladder.name,
        "words": ladder.words,
        "unit": ladder.unit,
        "keys": ladder.keys.split("|") if ladder.keys else [],
        "clean": _rung(result.clean, result),
        "rungs": [
            {**_rung(measured, result), "keys": rung.keys.split("|")}
            for measured, rung in zip(result.rungs, ladder.rungs, strict=True)
        ],
        "verdicts": {learnt: asdict(v) for learnt, v in verdicts(result).items()},
    }


def _rung(rung: RungResult, result: LadderResult) -> dict[str, Any]:
    told = {learnt: {**asdict(f), "rate": f.rate} for learnt, f in rung.figures.items()}
    return {"label": rung.label, "changed_grey_levels": _changed(rung, result), "taught": told}


def _changed(rung: RungResult, result: LadderResult) -> float:
    return changed(rung.sample, result.clean.sample)


def markdown(results: Sequence[LadderResult], *, runs: int) -> str:
    """Return the page: verdicts first, then each ladder's rungs."""
    clean = results[0].clean.figures[FROM_CLEAN]
    head = _HEAD.format(runs=runs, frames=clean.frames // runs, odometry=clean.odometry_max_m)
    tables = (line for result in results for line in _rung_table(result))
    return "\n".join([head, *verdict_table(results), *tables]) + "\n"


def verdict_table(results: Sequence[LadderResult]) -> Iterator[str]:
    """Yield the table's lines: at which rung each ladder starts to fail."""
    yield from _row("ladder", "unit", "rungs", "found < 90 %", "< 50 %", "EKF > 2x", "> 0.6 m",
                    "taught anew: < 90 %", "< 50 %", "> 0.6 m")  # fmt: skip
    yield from _row(*["---"] * 10)
    for result in results:
        taught = verdicts(result)
        clean, anew = taught[FROM_CLEAN], taught[FROM_SAME]
        happens = (clean.falters, clean.fails, clean.drifts, clean.lost)
        again = (anew.falters, anew.fails, anew.lost)
        yield from _row(
            result.ladder.name,
            result.ladder.unit,
            f"{result.rungs[0].label} … {result.rungs[-1].label}",
            *(label or "–" for label in (*happens, *again)),
        )


def _rung_table(result: LadderResult) -> Iterator[str]:
    ladder = result.ladder
    yield from ("", f"## {ladder.name}", "", f"{ladder.words[0].upper()}{ladder.words[1:]}.", "")
    yield from _row(ladder.unit, *_RUNG_HEAD)
    yield from _row(*["---"] * (1 + len(_RUNG_HEAD)))
    for rung in (result.clean, *result.rungs):
        taught = rung.figures[FROM_CLEAN]
        anew = rung.figures.get(FROM_SAME, taught)
        level = f"{_changed(rung, result):.1f}"
        yield from _row(rung.label, level, *_cells(taught), *_short_cells(anew))


def _cells(f: Figures) -> tuple[str, ...]:
    bearing = "–" if f.bearing_rms_deg is None else f"{f.bearing_rms_deg:.2f}°"
    range_ = "–" if f.range_rms_m is None else f"{1e3 * f.range_rms_m:.0f} mm"
    found, false, largest = _short_cells(f)
    return found, false, bearing, range_, largest, f"{f.ekf_final_m:.2f} m"


def _short_cells(f: Figures) -> tuple[str, str, str]:
    return f"{f.rate:.0%}", f"{f.false_a_frame:.2f}", f"{f.ekf_max_m:.2f} m"


def _row(*cells: str) -> Iterator[str]:
    yield f"| {' | '.join(cells)} |"
