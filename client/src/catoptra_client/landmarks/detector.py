"""Landmark detector: from an omnidirectional frame to detections.

Frame -> cylinder -> colour codes -> blobs -> candidates -> detections: each step is a function on
frozen data, and `Detector` holds the parts computed once. `detect_with_stages` also returns the
intermediate results, for display. Source: Schmits & Visser 2009, section 3.2: colour histogram
landmark detection on cylindrical projections.
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

# Columns of 0.5 degrees, rows of 0.41 at the horizon, where a pixel of a 360 px frame spans 0.55.
# From 6 degrees above the horizon, for higher landmarks and a tilted robot, to 50 below: the lower
# band of a beacon 0.33 m away.
DEFAULT_CYLINDER = CylinderGeometry(columns=720, rows=180, top_slope=-0.1, bottom_slope=1.2)
DEFAULT_VIEWPOINT = Viewpoint()
# 2 x 2 px: noise produces smaller blobs, whose centroids are uncertain by a pixel.
MIN_BLOB_PIXELS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Detector:
    """Constant part of a detector: maps, classifier and landmarks for one camera."""

    view: CylinderView
    unwarp_map: UnwarpMap
    classifier: ColourClassifier
    landmarks: tuple[Landmark, ...]


@dataclass(frozen=True, slots=True, eq=False)
class DetectionStages:
    """Intermediate results of the detector for one frame."""

    cylinder: UInt8Array
    """Cylinder image, (rows, columns, 3) RGB."""
    labels: UInt8Array
    """Colour codes, (rows, columns)."""
    blobs: tuple[Blob, ...]
    """Blobs of at least `MIN_BLOB_PIXELS`."""
    detections: tuple[Detection, ...]
    """Detected landmarks."""
    unused_blobs: tuple[Blob, ...]
    """Blobs that belong to no detection."""


def make_detector(
    camera: OmniCamera,
    classifier: ColourClassifier,
    *,
    landmarks: Sequence[Landmark],
    viewpoint: Viewpoint = DEFAULT_VIEWPOINT,
    cylinder: CylinderGeometry = DEFAULT_CYLINDER,
) -> Detector:
    """Detector of a set of landmarks; computes the cylinder's unwarp map.

    Args:
        camera: model of the camera that delivers the frames.
        classifier: trained pixel classifiers.
        landmarks: landmarks to detect, with distinct colours.
        viewpoint: position and mount of the effective viewpoint on the robot.
        cylinder: geometry of the unwarped image.

    Raises:
        DomainError: two landmarks have the same kind and colours.
    """
    require_distinct_colours(landmarks)
    view = CylinderView(camera, cylinder, viewpoint)
    unwarp_map = make_unwarp_map(camera, cylinder, robot_from_mirror=viewpoint.rotation)
    return Detector(view, unwarp_map, classifier, tuple(landmarks))


def detect(detector: Detector, frame: UInt8Array) -> tuple[Detection, ...]:
    """Landmarks in an omnidirectional (h, w, 3) RGB frame."""
    return detect_with_stages(detector, frame).detections


def detect_with_stages(detector: Detector, frame: UInt8Array) -> DetectionStages:
    """Landmarks in an omnidirectional (h, w, 3) RGB frame, with all intermediate results."""
    cylinder = unwarp(frame, detector.unwarp_map)
    labels = label_image(detector.classifier, cylinder)
    blobs = blobs_from_labels(labels, min_pixels=MIN_BLOB_PIXELS)
    candidates = select_candidates(detector, blobs)
    used = {id(blob) for candidate in candidates for blob in candidate.blobs}
    unused = tuple(blob for blob in blobs if id(blob) not in used)
    return DetectionStages(
        cylinder, labels, blobs, tuple(_make_detection(detector, c) for c in candidates), unused
    )


def select_candidates(detector: Detector, blobs: Sequence[Blob]) -> list[Candidate]:
    """Best candidate of each landmark; a blob belongs to at most one candidate.

    Beacons are assigned before goals.
    """
    view, landmarks = detector.view, detector.landmarks
    beacons = [landmark for landmark in landmarks if landmark.kind == "beacon"]
    goals = [landmark for landmark in landmarks if landmark.kind == "goal"]
    chosen = _select_largest(
        [c for landmark in beacons for c in find_beacon_candidates(view, landmark, blobs)]
    )
    # Beacons first: two stacked colours are a stronger cue than the one colour of a goal.
    assigned = {id(blob) for candidate in chosen for blob in candidate.blobs}
    free = [blob for blob in blobs if id(blob) not in assigned]
    return chosen + _select_largest(
        [c for landmark in goals for c in find_goal_candidates(view, landmark, free)]
    )


def _select_largest(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Candidates from the largest down, skipping landmarks and blobs that are already assigned."""
    chosen: list[Candidate] = []
    names: set[str] = set()
    assigned: set[int] = set()
    for candidate in sorted(candidates, key=lambda c: -c.num_pixels):
        parts = {id(blob) for blob in candidate.blobs}
        if candidate.landmark.name not in names and not parts & assigned:
            chosen.append(candidate)
            names.add(candidate.landmark.name)
            assigned |= parts
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
