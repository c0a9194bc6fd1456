"""The gap between photographs and twins, how much of it each effect closes, and Eq. 3's transfer.

A quantity has a value for each photograph; the gap is the difference of its means over photographs
and over twins, and an effect closes 1 - |gap with it| / |gap of the clean twin|: 1 all of it, 0
nothing, below 0 it leads away. The interval is the bootstrap's (Efron 1979): the same photographs
drawn with replacement for both sides, 95 %. Photographs whose twin's board was not found with the
effect do not count, on neither side; the number says so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
import numpy.typing as npt

from catoptra_client.landmarks.classifier import (
    Histogram,
    likelihood_ratio_test,
    merge_histograms,
    smooth_histogram,
)
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_studies.real.picture_measures import CLASSES, PictureMeasures, shading_loss

CLEAN = "clean twin"
_NUM_DRAWS, _SEED = 1000, 45
# A difference of colours without a common bin is infinite; of so little it is 6.9.
_MIN_OVERLAP = 1e-3
# Of Eq. 3 between classes that are as likely as each other.
_THETA = 1.0
_LOW_DEG, _HIGH_DEG = 80.0, 95.0


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """What one picture, a photograph or a twin, gives to the table."""

    measures: PictureMeasures
    corner_square_px: float
    """Mean square of the corners off the best pose; NaN if the board was not found."""
    calibration_square_px: float
    """The same with a camera that was calibrated by other pictures of the kind."""
    false_share: float
    """Share of the picture's pixels that the landmark classifier takes for a landmark."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its interval and the number of photographs."""

    value: float
    low: float
    high: float
    count: int

    def __str__(self) -> str:
        if not math.isfinite(self.value):
            return "–"
        return f"{self.value:.2f} [{self.low:.2f}, {self.high:.2f}] ({self.count})"


@dataclass(frozen=True, slots=True)
class Quantity:
    """A row of the table: components of a picture, and the number that their means make."""

    name: str
    read: Callable[[Sample, Sample], tuple[float, ...]]
    """Components of a picture, beside the photograph of the same board."""
    combine: Callable[[Floats], Floats]
    """Number of (..., k) mean components, (...)."""
    is_distance: bool = False
    """Whether the value is a distance from the photograph itself, whose own is 0."""


def _mean(components: Floats) -> Floats:
    return np.asarray(components[..., 0])


def _root(components: Floats) -> Floats:
    return np.sqrt(components[..., 0])


def _width(low_deg: float, high_deg: float) -> Callable[[Sample, Sample], tuple[float, ...]]:
    def read(one: Sample, _: Sample) -> tuple[float, ...]:
        angle = np.degrees(one.measures.edge_incidence_rad)
        chosen = one.measures.edge_widths_px[(angle >= low_deg) & (angle < high_deg)]
        return (float(np.median(chosen)) if len(chosen) else math.nan,)

    return read


def _distance(names: Sequence[str]) -> Callable[[Sample, Sample], tuple[float, ...]]:
    def read(one: Sample, photograph: Sample) -> tuple[float, ...]:
        each = [
            bhattacharyya(one.measures.histograms[name], photograph.measures.histograms[name])
            for name in names
        ]
        return (sum(each) / len(each),)

    return read


QUANTITIES = (
    Quantity("corners off the best pose, px rms", lambda s, _: (s.corner_square_px,), _root),
    Quantity("calibration, cross-validated, px rms", lambda s, _: (s.calibration_square_px,),
             _root),
    Quantity("edge width 10-90 %, px", _width(0.0, 180.0), _mean),
    Quantity(f"edge width below {_LOW_DEG:.0f}°, px", _width(0.0, _LOW_DEG), _mean),
    Quantity(f"edge width above {_HIGH_DEG:.0f}°, px", _width(_HIGH_DEG, 180.0), _mean),
    Quantity("noise of white, grey levels", lambda s, _: (s.measures.noise(True),), _mean),
    Quantity("noise of black, grey levels", lambda s, _: (s.measures.noise(False),), _mean),
    Quantity("light lost at the rim, share", lambda s, _: s.measures.shading_sums, shading_loss),
    Quantity("colours of squares, Bhattacharyya", _distance(("black", "white")), _mean, True),
    Quantity("colours of the room, Bhattacharyya", _distance(("room",)), _mean, True),
    Quantity("false landmark pixels, %", lambda s, _: (100.0 * s.false_share,), _mean),
)  # fmt: skip
"""Rows of the table."""


def bhattacharyya(one: Histogram, other: Histogram) -> float:
    """Distance of two distributions, smoothed as training smooths; 0 of the same."""
    p, q = (smooth_histogram(each).counts / max(64 * each.total, 1) for each in (one, other))
    return -math.log(max(float(np.sqrt(p * q).sum()), _MIN_OVERLAP))


@dataclass(frozen=True, slots=True)
class GapRow:
    """One quantity, by the name of the twins: its value, what is left, and what that closes."""

    quantity: str
    values: Mapping[str, Estimate]
    """Of the photographs, too."""
    remainder: Mapping[str, Estimate]
    """Twins less photographs, of the same boards."""
    closed: Mapping[str, Estimate]
    """Part of the clean twin's gap."""


def compare_pictures(samples: Mapping[str, Sequence[Sample]]) -> tuple[GapRow, ...]:
    """Rows of the table; samples by name, "photographs" and CLEAN among them, in one order."""
    return tuple(_compare(quantity, samples) for quantity in QUANTITIES)


def _compare(quantity: Quantity, samples: Mapping[str, Sequence[Sample]]) -> GapRow:
    photographs = samples["photographs"]
    rows = {
        name: np.array(
            [quantity.read(one, photo) for one, photo in zip(each, photographs, strict=True)]
        )
        for name, each in samples.items()
    }

    def find_rest(photograph: Floats, twin: Floats) -> Floats:
        rest = quantity.combine(twin)
        return rest if quantity.is_distance else rest - quantity.combine(photograph)

    def find_part(photograph: Floats, clean: Floats, effect: Floats) -> Floats:
        gap = np.abs(find_rest(photograph, clean))
        with np.errstate(divide="ignore", invalid="ignore"):
            return 1.0 - np.abs(find_rest(photograph, effect)) / np.where(gap > 0.0, gap, np.nan)

    truth, clean = rows["photographs"], rows[CLEAN]
    twins = {name: one for name, one in rows.items() if name != "photographs"}
    return GapRow(
        quantity.name,
        {name: _bootstrap(quantity.combine, one) for name, one in rows.items()},
        {name: _bootstrap(find_rest, truth, one) for name, one in twins.items()},
        {name: _bootstrap(find_part, truth, clean, one) for name, one in twins.items()
         if name != CLEAN},
    )  # fmt: skip


def _bootstrap(statistic: Callable[..., Floats], *rows: Floats) -> Estimate:
    """Statistic of the means of rows, with its interval over the pictures that all rows have."""
    present = np.logical_and.reduce([np.isfinite(each).all(axis=1) for each in rows])
    count = int(present.sum())
    if count < 2:
        return Estimate(math.nan, math.nan, math.nan, count)
    kept = [each[present] for each in rows]
    value = float(statistic(*(each.mean(axis=0) for each in kept)))
    chosen = np.random.default_rng((_SEED, count)).integers(count, size=(_NUM_DRAWS, count))
    drawn = statistic(*(each[chosen].mean(axis=1) for each in kept))
    finite = drawn[np.isfinite(drawn)]
    low, high = np.percentile(finite, (2.5, 97.5)) if len(finite) else (math.nan, math.nan)
    return Estimate(value, float(low), float(high), count)


@dataclass(frozen=True, slots=True)
class TransferRow:
    """Eq. 3 for one class, trained on some pictures and judged on photographs."""

    training: str
    class_name: str
    hits: Estimate
    """Share of the class's pixels that are accepted."""
    false_positives: Estimate
    """Share of the other classes' pixels that are accepted."""


def judge_transfer(samples: Mapping[str, Sequence[Sample]]) -> tuple[TransferRow, ...]:
    """Eq. 3's classifiers, trained on one half of each kind of pictures, judged on the photographs
    of the other half.
    """
    judged = samples["photographs"][1::2]
    rows = []
    for training, each in samples.items():
        learnt = [one.measures.histograms for one in each[::2]]
        trained = {name: reduce(merge_histograms, (one[name] for one in learnt))
                   for name in CLASSES}  # fmt: skip
        for name in CLASSES:
            others = reduce(
                merge_histograms, (trained[other] for other in CLASSES if other != name)
            )
            if not (trained[name].total and others.total):
                continue
            accepted = likelihood_ratio_test(
                smooth_histogram(trained[name]), smooth_histogram(others), theta=_THETA
            )
            shares = np.array([_accepted_shares(one, name, accepted) for one in judged])
            hits, false = (_bootstrap(_mean, shares[:, [column]]) for column in (0, 1))
            rows.append(TransferRow(training, name, hits, false))
    return tuple(rows)


def _accepted_shares(
    sample: Sample, name: str, accepted: npt.NDArray[np.bool_]
) -> tuple[float, float]:
    """Shares of a class's and of the other classes' pixels in accepted bins."""
    histograms = sample.measures.histograms
    others = reduce(merge_histograms, (histograms[other] for other in CLASSES if other != name))
    return _share(histograms[name], accepted), _share(others, accepted)


def _share(histogram: Histogram, accepted: Bools) -> float:
    total = histogram.total
    return float(histogram.counts[accepted].sum()) / total if total else math.nan
