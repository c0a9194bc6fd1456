"""The detector: a frame in, landmarks out.

Frame -> cylinder -> colour codes -> blobs -> candidates -> detections, each step a function on
frozen data; `Detector` holds what is computed once. `look` keeps the steps in between for people to
see. Source: Schmits & Visser 2009, section 3.2: colour histogram landmark detection on cylindrical
projections.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from catoptra_client.landmarks.beacons import find_beacon_candidates
from catoptra_client.landmarks.blobs import Blob, blobs_from_labels
from catoptra_client.landmarks.candidates import Candidate, CylinderView, require_distinct_colours
from catoptra_client.landmarks.classifier import ColourClassifier, label_image
from catoptra_client.landmarks.detection import (
    Detection,
    bearing_detection_from_measurement,
    detection_from_measurement,
)
from catoptra_client.landmarks.goals import find_goal_candidates
from catoptra_client.landmarks.histogram import UInt8Array
from catoptra_client.landmarks.viewpoint import Viewpoint
from catoptra_client.unwarp import CylinderGeometry, UnwarpMap, make_unwarp_map, unwarp
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.omni_camera import OmniCamera

# Columns of 0.5 degrees and rows of 0.41 at the horizon, where a pixel of a 360 px frame has 0.55.
# From 6 degrees above it, for higher landmarks and a tilted robot, to 50 below: the lower band of a
# beacon 0.33 m away.
DEFAULT_CYLINDER = CylinderGeometry(columns=720, rows=180, top_slope=-0.1, bottom_slope=1.2)
DEFAULT_VIEWPOINT = Viewpoint()
# 2 x 2 px: a smaller blob's centroid is known no better than one pixel, and noise makes such blobs.
MIN_BLOB_PIXELS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Detector:
    """Everything that does not change from frame to frame."""

    view: CylinderView
    unwarp_map: UnwarpMap
    classifier: ColourClassifier
    landmarks: tuple[Landmark, ...]


@dataclass(frozen=True, slots=True, eq=False)
class DetectionStages:
    """What the detector saw in one frame, step by step.

    cylinder (rows, columns, 3) RGB; labels (rows, columns) colour codes; unused: blobs of landmark
    colours that are part of no landmark.
    """

    cylinder: UInt8Array
    labels: UInt8Array
    blobs: tuple[Blob, ...]
    detections: tuple[Detection, ...]
    unused_blobs: tuple[Blob, ...]


def make_detector(
    camera: OmniCamera,
    classifier: ColourClassifier,
    *,
    landmarks: Sequence[Landmark],
    viewpoint: Viewpoint = DEFAULT_VIEWPOINT,
    cylinder: CylinderGeometry = DEFAULT_CYLINDER,
) -> Detector:
    """Return a detector of these landmarks; computes the cylinder's map.

    Raises DomainError for two landmarks that look the same.
    """
    require_distinct_colours(landmarks)
    eye = CylinderView(camera, cylinder, viewpoint)
    return Detector(eye, make_unwarp_map(camera, cylinder), classifier, tuple(landmarks))


def detect(detector: Detector, frame: UInt8Array) -> tuple[Detection, ...]:
    """Return the landmarks in an omnidirectional (h, w, 3) RGB frame."""
    return detect_with_stages(detector, frame).detections


def detect_with_stages(detector: Detector, frame: UInt8Array) -> DetectionStages:
    """Return the landmarks in an omnidirectional (h, w, 3) RGB frame, and how they were found."""
    cylinder = unwarp(frame, detector.unwarp_map)
    labels = label_image(detector.classifier, cylinder)
    blobs = blobs_from_labels(labels, min_pixels=MIN_BLOB_PIXELS)
    found = select_candidates(detector, blobs)
    used = {id(blob) for candidate in found for blob in candidate.blobs}
    unused = tuple(blob for blob in blobs if id(blob) not in used)
    return DetectionStages(
        cylinder, labels, blobs, tuple(_make_detection(detector, c) for c in found), unused
    )


def select_candidates(detector: Detector, blobs: Sequence[Blob]) -> list[Candidate]:
    """Return the best candidate of each landmark, no blob in two of them; beacons choose first."""
    eye, landmarks = detector.view, detector.landmarks
    beacons = [landmark for landmark in landmarks if landmark.kind == "beacon"]
    goals = [landmark for landmark in landmarks if landmark.kind == "goal"]
    chosen = _select_largest(
        [c for row in beacons for c in find_beacon_candidates(eye, row, blobs)]
    )
    taken = {id(blob) for candidate in chosen for blob in candidate.blobs}
    free = [blob for blob in blobs if id(blob) not in taken]
    return chosen + _select_largest(
        [c for row in goals for c in find_goal_candidates(eye, row, free)]
    )


def _select_largest(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return candidates from the largest down, without those whose name or blob is taken."""
    chosen: list[Candidate] = []
    names: set[str] = set()
    taken: set[int] = set()
    for candidate in sorted(candidates, key=lambda c: -c.num_pixels):
        parts = {id(blob) for blob in candidate.blobs}
        if candidate.landmark.name not in names and not parts & taken:
            chosen.append(candidate)
            names.add(candidate.landmark.name)
            taken |= parts
    return chosen


def _make_detection(detector: Detector, candidate: Candidate) -> Detection:
    make = detection_from_measurement if candidate.has_range else bearing_detection_from_measurement
    landmark, viewpoint = candidate.landmark, detector.view.viewpoint
    return make(
        landmark.name,
        landmark.kind,
        candidate.measurement,
        viewpoint=viewpoint,
        num_pixels=candidate.num_pixels,
    )
