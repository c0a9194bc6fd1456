"""How well a detector did over films, and where the filter believed the robot to be."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from catoptra_client.experiment.degraded.film import Film, with_sightings
from catoptra_client.experiment.recording import Step
from catoptra_client.experiment.replay import Trace, replay
from catoptra_client.experiment.setups import LONGEST_RANGE_M, PAPER_FILTER, Setup
from catoptra_client.landmarks import Detection
from catoptra_client.localization import landmark_map
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import wrap_angle

# Two sigmas of the bearing that the paper's filter believes: farther off is another thing.
SAME_WITHIN_RAD = math.radians(5.0)

Sightings = Sequence[Sequence[Detection]]


@dataclass(frozen=True, slots=True)
class Figures:
    """What came of some films.

    visible: beacons that the stream called visible, within the range that is used; found: those of
    them that were detected within SAME_WITHIN_RAD of their bearing. false_a_frame: detections
    of what is not there. Errors are of what was found, rms; None where nothing was. EKF errors are
    the paper's filter's, metres, medians over the films.
    """

    frames: int
    visible: int
    found: int
    false_a_frame: float
    bearing_rms_deg: float | None
    range_rms_m: float | None
    ekf_max_m: float
    ekf_final_m: float
    odometry_max_m: float

    @property
    def rate(self) -> float:
        """Return the share of the visible beacons that were found; 0 where there was none."""
        return self.found / self.visible if self.visible else 0.0


@dataclass(frozen=True, slots=True)
class Judged:
    """A frame's sightings, judged: errors (range in m, bearing in rad) of each one found."""

    visible: frozenset[str]
    found: dict[str, tuple[float, float]]
    false: tuple[Detection, ...]


def figures(
    films: Sequence[Film],
    found: Sequence[Sightings],
    *,
    setup: Setup,
    landmarks: Sequence[Landmark],
) -> Figures:
    """Return the figures of films with what a detector found in each of their shots."""
    judged = [j for film, seen in zip(films, found, strict=True) for j in judgements(film, seen)]
    errors = [error for frame in judged for error in frame.found.values()]
    traces = _traces(films, found, setup, landmarks)
    range_m, bearing_rad = _rms(errors)
    return Figures(
        frames=len(judged),
        visible=sum(len(frame.visible) for frame in judged),
        found=len(errors),
        false_a_frame=sum(len(frame.false) for frame in judged) / len(judged),
        bearing_rms_deg=None if bearing_rad is None else math.degrees(bearing_rad),
        range_rms_m=range_m,
        ekf_max_m=_median([trace.estimate_error_m.max() for trace in traces]),
        ekf_final_m=_median([trace.estimate_error_m[-1] for trace in traces]),
        odometry_max_m=_median([trace.odometry_error_m.max() for trace in traces]),
    )


def judgements(film: Film, found: Sightings) -> Iterator[Judged]:
    """Yield for each shot what was there, what was found of it, and what else."""
    for step, shot, seen in zip(film.drive.steps[1:], film.shots, found, strict=True):
        shown = {s.landmark.name: s.landmark for s in shot.landmarks if s.visible}
        polar = {name: true_polar(step, mark) for name, mark in shown.items()}
        yield judged(polar, {n for n, m in shown.items() if m.kind == "beacon"}, seen)


def judged(
    polar: dict[str, tuple[float, float]], beacons: set[str], seen: Sequence[Detection]
) -> Judged:
    """Return the judgement of a frame; polar: (range, bearing) of all that is visible in it."""
    visible = frozenset(name for name in beacons if polar[name][0] <= LONGEST_RANGE_M)
    found, false = {}, []
    for one in seen:
        there = polar.get(one.name)
        off_rad = math.inf if there is None else wrap_angle(one.bearing_rad - there[1])
        if there is None or abs(off_rad) > SAME_WITHIN_RAD:
            false.append(one)
        elif one.name in visible:
            found[one.name] = (one.range_m - there[0], off_rad)
    return Judged(visible, found, tuple(false))


def true_polar(step: Step, landmark: Landmark) -> tuple[float, float]:
    """Return true range in metres and bearing in radians of a landmark from a step's place."""
    dx, dy = landmark.x_m - step.truth.x_m, landmark.y_m - step.truth.y_m
    return math.hypot(dx, dy), wrap_angle(math.atan2(dy, dx) - step.truth.yaw_rad)


def _traces(
    films: Sequence[Film],
    found: Sequence[Sightings],
    setup: Setup,
    landmarks: Sequence[Landmark],
) -> list[Trace]:
    known = landmark_map(landmarks)
    drives = (with_sightings(film, seen) for film, seen in zip(films, found, strict=True))
    return [replay(drive, setup, PAPER_FILTER, known) for drive in drives]


def _rms(errors: Sequence[tuple[float, float]]) -> tuple[float | None, float | None]:
    if not errors:
        return None, None
    range_m, bearing_rad = np.sqrt(np.mean(np.square(errors), axis=0))
    return float(range_m), float(bearing_rad)


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))
