"""How well a detector did over films, and where the filter believed the robot to be."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from catoptra_client.landmarks import Detection
from catoptra_client.localization import make_landmark_map
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_studies.degradation.recorded_drive import RecordedDrive, add_measurements
from catoptra_studies.experiment.drive_log import DriveStep
from catoptra_studies.experiment.experiment_setups import MAX_RANGE_M, PAPER_FILTER, ExperimentSetup
from catoptra_studies.experiment.filter_replay import FilterRun, replay_filter

# Two sigmas of the bearing that the paper's filter believes: farther off is another thing.
MATCH_TOLERANCE_RAD = math.radians(5.0)

DriveDetections = Sequence[Sequence[Detection]]


@dataclass(frozen=True, slots=True)
class DegradationMetrics:
    """What came of some films.

    visible: beacons that the stream called visible, within the range that is used; found: those of
    them that were detected within MATCH_TOLERANCE_RAD of their bearing. false_per_frame: detections
    of what is not there. Errors are of what was found, rms; None where nothing was. EKF errors are
    the paper's filter's, metres, medians over the films.
    """

    num_frames: int
    num_visible: int
    num_detected: int
    false_per_frame: float
    bearing_rms_deg: float | None
    range_rms_m: float | None
    ekf_max_m: float
    ekf_final_m: float
    odometry_max_m: float

    @property
    def detection_rate(self) -> float:
        """Return the share of the visible beacons that were found; 0 where there was none."""
        return self.num_detected / self.num_visible if self.num_visible else 0.0


@dataclass(frozen=True, slots=True)
class FrameEvaluation:
    """A frame's sightings, judged: errors (range in m, bearing in rad) of each one found."""

    visible_beacons: frozenset[str]
    detection_errors: dict[str, tuple[float, float]]
    false_detections: tuple[Detection, ...]


def compute_degradation_metrics(
    drives: Sequence[RecordedDrive],
    detections: Sequence[DriveDetections],
    *,
    setup: ExperimentSetup,
    landmarks: Sequence[Landmark],
) -> DegradationMetrics:
    """Return the figures of films with what a detector found in each of their shots."""
    judged = [
        j for film, seen in zip(drives, detections, strict=True) for j in evaluate_drive(film, seen)
    ]
    errors = [error for frame in judged for error in frame.detection_errors.values()]
    traces = _run_filter(drives, detections, setup, landmarks)
    range_m, bearing_rad = _rms_errors(errors)
    return DegradationMetrics(
        num_frames=len(judged),
        num_visible=sum(len(frame.visible_beacons) for frame in judged),
        num_detected=len(errors),
        false_per_frame=sum(len(frame.false_detections) for frame in judged) / len(judged),
        bearing_rms_deg=None if bearing_rad is None else math.degrees(bearing_rad),
        range_rms_m=range_m,
        ekf_max_m=_median([trace.estimate_error_m.max() for trace in traces]),
        ekf_final_m=_median([trace.estimate_error_m[-1] for trace in traces]),
        odometry_max_m=_median([trace.odometry_error_m.max() for trace in traces]),
    )


def evaluate_drive(drive: RecordedDrive, detections: DriveDetections) -> Iterator[FrameEvaluation]:
    """Yield for each shot what was there, what was found of it, and what else."""
    for step, shot, seen in zip(drive.log.steps[1:], drive.frames, detections, strict=True):
        shown = {s.landmark.name: s.landmark for s in shot.landmarks if s.visible}
        polar = {name: true_range_bearing(step, mark) for name, mark in shown.items()}
        yield evaluate_frame(polar, {n for n, m in shown.items() if m.kind == "beacon"}, seen)


def evaluate_frame(
    range_bearing: dict[str, tuple[float, float]],
    beacons: set[str],
    detections: Sequence[Detection],
) -> FrameEvaluation:
    """Return the judgement of a frame; polar: (range, bearing) of all that is visible in it."""
    visible = frozenset(name for name in beacons if range_bearing[name][0] <= MAX_RANGE_M)
    found, false = {}, []
    for one in detections:
        there = range_bearing.get(one.name)
        off_rad = math.inf if there is None else wrap_angle(one.bearing_rad - there[1])
        if there is None or abs(off_rad) > MATCH_TOLERANCE_RAD:
            false.append(one)
        elif one.name in visible:
            found[one.name] = (one.range_m - there[0], off_rad)
    return FrameEvaluation(visible, found, tuple(false))


def true_range_bearing(step: DriveStep, landmark: Landmark) -> tuple[float, float]:
    """Return true range in metres and bearing in radians of a landmark from a step's place."""
    dx, dy = landmark.x_m - step.truth.x_m, landmark.y_m - step.truth.y_m
    return math.hypot(dx, dy), wrap_angle(math.atan2(dy, dx) - step.truth.yaw_rad)


def _run_filter(
    recorded_drives: Sequence[RecordedDrive],
    detections: Sequence[DriveDetections],
    setup: ExperimentSetup,
    landmarks: Sequence[Landmark],
) -> list[FilterRun]:
    known = make_landmark_map(landmarks)
    drives = (
        add_measurements(film, seen) for film, seen in zip(recorded_drives, detections, strict=True)
    )
    return [replay_filter(drive, setup, PAPER_FILTER, known) for drive in drives]


def _rms_errors(errors: Sequence[tuple[float, float]]) -> tuple[float | None, float | None]:
    if not errors:
        return None, None
    range_m, bearing_rad = np.sqrt(np.mean(np.square(errors), axis=0))
    return float(range_m), float(bearing_rad)


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))
