"""Where on a ladder colour classification starts to fail, and where the filter does."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from catoptra_client.experiment.degraded.measures import Figures

# The paper's limit: what its filter keeps below.
FILTER_LIMIT_M = 0.6


@dataclass(frozen=True, slots=True)
class Verdict:
    """The first rung where something happens; None where nothing does up to the last.

    falters, fails: fewer than nine tenths, than half of the beacons found that were found in clean
    pictures. drifts: the filter's largest error more than doubles. lost: it exceeds FILTER_LIMIT_M.
    """

    falters: str | None
    fails: str | None
    drifts: str | None
    lost: str | None


def verdict(clean: Figures, rungs: Sequence[tuple[str, Figures]]) -> Verdict:
    """Return the verdict on a ladder: its clean figures, and (label, figures) of its rungs."""
    return Verdict(
        falters=_first(rungs, lambda f: f.rate < 0.9 * clean.rate),
        fails=_first(rungs, lambda f: f.rate < 0.5 * clean.rate),
        drifts=_first(rungs, lambda f: f.ekf_max_m > 2.0 * clean.ekf_max_m),
        lost=_first(rungs, lambda f: f.ekf_max_m > FILTER_LIMIT_M),
    )


def _first(rungs: Sequence[tuple[str, Figures]], happens: Callable[[Figures], bool]) -> str | None:
    return next((label for label, figures in rungs if happens(figures)), None)
