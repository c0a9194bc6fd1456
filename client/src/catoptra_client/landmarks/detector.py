"""Landmark detector: from an omnidirectional frame to detections of goals and beacons.

Frame -> colour codes -> cylinder -> blobs -> candidates -> detections: each step is a function on
frozen data, and `Detector` holds the parts computed once. `detect_with_stages` also returns the
intermediate results, for display.

Goals are one wide blob of one colour on the floor: a bearing, no range. Mouth, sides and back of a
goal stand at ranges that differ by the depth, and the visible ones depend on the robot's position:
any single range could be wrong by decimetres. The bearing is the centre of the blob's box. From the
side that centre shifts from the centre of the mouth towards the box behind, by up to half the
depth, which the sigma of the bearing covers.

Beacons are pairs of stacked blobs in a beacon's two colours, consistent with one range. Rows are
linear in y = (H - z) / r, so the centroid of the lower band, at the height of the band's centre,
gives r without bias. The upper band is not used, for two reasons: it lies nearer to the horizon,
and the lid, which has the upper colour and is visible from above, raises the centroid. The blob
shows the front of the cylinder, which is nearer than the axis by radius * sqrt(1 - s^2) over the
relative width s; the mean, radius * pi / 4, is added. Source: Schmits & Visser 2009, section 3.2:
colour histogram landmark detection on cylindrical projections.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from catoptra_client.landmarks.blobs import Blob, Viewpoint, blobs_from_labels
from catoptra_client.landmarks.candidates import (
    Candidate,
    CylinderView,
    Detection,
    PolarMeasurement,
    detection_from_candidate,
    is_clear_of_horizon,
    range_from_slope,
    range_sigma_from_angle,
    require_distinct_colours,
)
from catoptra_client.landmarks.classifier import ColourClassifier, UInt8Array, label_image
from catoptra_client.unwarp import (
    CylinderGeometry,
    UnwarpMap,
    make_unwarp_map,
    unwarp,
    unwarp_labels,
)
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import interpolate_angle
from catoptra_protocol.optics.omni_camera import OmniCamera

# Sigma across the line of sight, as a fraction of the goal's depth. Over the whole field the errors
# of the bearing have an rms of 0.5 sigma, 1 to 2 m beside the goal of 1.0 sigma. Measured in
# tests/client/landmarks/test_detector.py.
_LATERAL_SIGMA_FRACTION = 0.5
# The approximate range lies between mouth and back, and between the posts.
_RANGE_SIGMA_FRACTION = 0.5


def find_goal_candidates(
    view: CylinderView, landmark: Landmark, blobs: Sequence[Blob]
) -> list[Candidate]:
    """Blobs whose colour and size fit this goal, with an approximate range.

    The range is the one at which the blob's upper edge has the height of the boards. It serves to
    check the size and to move the bearing from the viewpoint to the robot's origin.
    """
    drop_m = view.drop_m(landmark, 1.0)
    candidates = []
    for blob in blobs:
        range_m, has_range = range_from_slope(view.cylinder.slope_from_row(blob.top), drop_m=drop_m)
        matches_colour = blob.colour == landmark.lower_colour and has_range
        if matches_colour and _is_goal(view, landmark, blob, range_m):
            measurement = _make_measurement(view, landmark, blob, range_m)
            candidates.append(Candidate(landmark, (blob,), measurement, False))
    return candidates


def _is_goal(
    view: CylinderView, landmark: Landmark, blob: Blob, approximate_range_m: float
) -> bool:
    """Whether a blob is as wide and high as a goal at this range, from some direction."""
    half_rad = 0.5 * blob.width * view.cylinder.azimuth_per_column_rad
    # No finite width at or beyond half a turn.
    if half_rad >= 0.5 * math.pi:
        return False
    width_m = 2.0 * approximate_range_m * math.tan(half_rad)
    height_m = blob.height * view.cylinder.slope_per_row * approximate_range_m
    boards_m = landmark.band_top_m - landmark.band_bottom_m
    # Narrowest along the mouth, where the depth shows; widest across the diagonal, and from close
    # by up to twice as wide.
    min_width_m = 0.8 * min(landmark.depth_m, landmark.width_m)
    max_width_m = 2.0 * math.hypot(landmark.width_m, landmark.depth_m)
    has_width = min_width_m <= width_m <= max_width_m
    # At least half of the boards is visible; the feet of near posts extend the blob downwards, to
    # four times the height of the boards at most.
    return has_width and 0.5 * boards_m <= height_m <= 4.0 * boards_m


def _make_measurement(
    view: CylinderView, landmark: Landmark, blob: Blob, approximate_range_m: float
) -> PolarMeasurement:
    lateral_rad = math.atan2(_LATERAL_SIGMA_FRACTION * landmark.depth_m, approximate_range_m)
    sigma_rad = math.hypot(lateral_rad, view.cylinder.azimuth_per_column_rad)
    azimuth = view.azimuth_from_column(0.5 * (blob.left + blob.right))
    return PolarMeasurement(
        approximate_range_m, azimuth, _RANGE_SIGMA_FRACTION * approximate_range_m, sigma_rad
    )


# Sigma of a band's centroid, in pixels of the frame. On exact frames the range errors have an rms
# of 0.5 (to 2 m) to 0.8 (at 3 m) of this sigma; the margin is for lights that differ from those in
# training. Measured in tests/client/landmarks/test_detector.py.
_CENTROID_SIGMA_PX = 0.2
# Above this relative sigma no range is reported: the mean of 1 / y is biased by sigma^2, here 4 %,
# and diverges soon after.
_MAX_RELATIVE_SIGMA = 0.2
# The labels cover the cylinder's front up to an unknown part of about a tenth of the radius.
_FRONT_SIGMA_FRACTION = 0.1
# Tolerances of a blob's size against the size predicted from the range: a ratio, plus one mixed
# pixel at each of the two borders.
_MAX_SIZE_RATIO, _EDGE_TOLERANCE_PX = 2.0, 2.0


def find_beacon_candidates(
    view: CylinderView, landmark: Landmark, blobs: Sequence[Blob]
) -> list[Candidate]:
    """Pairs of blobs whose colours, sizes and positions fit this beacon."""
    uppers = [blob for blob in blobs if blob.colour == landmark.upper_colour]
    candidates = []
    # The lower band fixes the range; an upper band then either fits that range or does not.
    for lower in blobs:
        if lower.colour != landmark.lower_colour:
            continue
        front_m, has_range = _front_range(view, landmark, lower)
        if not has_range:
            continue
        size = _predict_band_size(view, landmark, front_m)
        if _is_band(lower, size):
            matches = [
                upper
                for upper in uppers
                if _is_band(upper, size) and _is_above(view, landmark, lower, upper, front_m)
            ]
            candidates += [
                _make_candidate(view, landmark, lower, upper, front_m) for upper in matches
            ]
    return [candidate for candidate, has_bearing in candidates if has_bearing]


def _front_range(view: CylinderView, landmark: Landmark, lower: Blob) -> tuple[float, bool]:
    """Range of the lower band's front; invalid at the horizon or on its wrong side."""
    return range_from_slope(
        view.cylinder.slope_from_row(lower.row), drop_m=view.drop_m(landmark, 0.25)
    )


def _predict_band_size(
    view: CylinderView, landmark: Landmark, front_m: float
) -> tuple[float, float]:
    """Rows and columns of one band at this range."""
    # One colour fills half of the band between band_bottom_m and band_top_m.
    half_band_m = 0.5 * (landmark.band_top_m - landmark.band_bottom_m)
    rows = half_band_m / front_m / view.cylinder.slope_per_row
    radius_m = 0.5 * landmark.width_m
    # Tangents to the cylinder, whose axis is one radius behind the front.
    width_rad = 2.0 * math.asin(radius_m / (front_m + radius_m))
    return rows, width_rad / view.cylinder.azimuth_per_column_rad


def _is_band(blob: Blob, size: tuple[float, float]) -> bool:
    """Whether a blob has the predicted rows and columns of a band."""
    rows, columns = size
    return _is_size_consistent(blob.height, rows) and _is_size_consistent(blob.width, columns)


def _is_size_consistent(measured: float, expected: float) -> bool:
    low, high = (
        expected / _MAX_SIZE_RATIO - _EDGE_TOLERANCE_PX,
        expected * _MAX_SIZE_RATIO + _EDGE_TOLERANCE_PX,
    )
    return low <= measured <= high


def _is_above(
    view: CylinderView, landmark: Landmark, lower: Blob, upper: Blob, front_m: float
) -> bool:
    """Whether `upper` stands on `lower` as the upper band does at this range."""
    # 0.75: the centre of the upper half of the band.
    expected_row = view.cylinder.row_from_slope(view.drop_m(landmark, 0.75) / front_m)
    row_offset = abs(upper.row - expected_row)
    if upper.row >= lower.row or row_offset > 0.25 * lower.height + _EDGE_TOLERANCE_PX:
        return False
    # Across the seam too.
    column_offset = abs(math.remainder(upper.column - lower.column, view.cylinder.columns))
    return column_offset <= 0.25 * max(lower.width, upper.width) + _EDGE_TOLERANCE_PX


def _make_candidate(
    view: CylinderView, landmark: Landmark, lower: Blob, upper: Blob, front_m: float
) -> tuple[Candidate, bool]:
    """Candidate of a pair of blobs, and whether the azimuth is defined.

    The candidate has no range if the range is too uncertain or the lower band is cut off by the
    edge.
    """
    drop_m, radius_m = view.drop_m(landmark, 0.25), 0.5 * landmark.width_m
    axis_m = front_m + 0.25 * math.pi * radius_m
    # Weighted by pixels, since the variance of a centroid falls with the size of the blob.
    fraction = upper.num_pixels / (upper.num_pixels + lower.num_pixels)
    azimuth = interpolate_angle(
        view.azimuth_from_column(lower.column),
        view.azimuth_from_column(upper.column),
        fraction=fraction,
    )
    angle_sigma_rad, azimuth_sigma_rad, correlation, has_bearing = view.angle_sigmas(
        azimuth, drop_m=drop_m, range_m=front_m, sigma_px=_CENTROID_SIGMA_PX
    )
    range_sigma_m, clear_of_horizon = _axis_range_sigma(
        drop_m, front_m, radius_m, angle_sigma_rad if has_bearing else None
    )
    has_range = (
        clear_of_horizon
        and range_sigma_m <= _MAX_RELATIVE_SIGMA * axis_m
        and not view.touches_edge(lower)
    )
    # The range is drop tan(angle), whose derivative has the sign of the drop.
    along_m = angle_sigma_rad * (drop_m + front_m / drop_m * front_m) if has_range else 0.0
    covariance = correlation * along_m * azimuth_sigma_rad
    measurement = PolarMeasurement(axis_m, azimuth, range_sigma_m, azimuth_sigma_rad, covariance)
    return Candidate(landmark, (lower, upper), measurement, has_range), has_bearing


def _axis_range_sigma(
    drop_m: float, front_m: float, radius_m: float, sigma_rad: float | None
) -> tuple[float, bool]:
    """Sigma of the range to the beacon's axis, and whether the band is clear of the horizon.

    Where the sigma is undefined, the range itself is returned in its place. `sigma_rad` is that of
    the band's angle from the vertical; None where it is undefined.
    """
    if sigma_rad is None:
        return front_m, False
    sigma_m, defined = range_sigma_from_angle(drop_m=drop_m, range_m=front_m, sigma_rad=sigma_rad)
    if not defined:
        return front_m, False
    clear = is_clear_of_horizon(drop_m=drop_m, range_m=front_m, sigma_rad=sigma_rad)
    return math.hypot(sigma_m, _FRONT_SIGMA_FRACTION * radius_m), clear


# Columns of 0.5 degrees, rows of 0.41 at the horizon, where a pixel of a 360 px frame spans 0.55.
# From 6 degrees above the horizon, for higher landmarks and a tilted robot, to 50 below: the lower
# band of a beacon 0.33 m away.
DEFAULT_CYLINDER = CylinderGeometry(columns=720, rows=180, top_slope=-0.1, bottom_slope=1.2)
_DEFAULT_VIEWPOINT = Viewpoint()
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
    viewpoint: Viewpoint = _DEFAULT_VIEWPOINT,
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
    _, blobs = _find_blobs(detector, frame)
    return _make_detections(detector, select_candidates(detector, blobs))


def detect_with_stages(detector: Detector, frame: UInt8Array) -> DetectionStages:
    """Landmarks in an omnidirectional (h, w, 3) RGB frame, with all intermediate results."""
    labels, blobs = _find_blobs(detector, frame)
    candidates = select_candidates(detector, blobs)
    used = {id(blob) for candidate in candidates for blob in candidate.blobs}
    unused = tuple(blob for blob in blobs if id(blob) not in used)
    detections = _make_detections(detector, candidates)
    return DetectionStages(unwarp(frame, detector.unwarp_map), labels, blobs, detections, unused)


def _find_blobs(detector: Detector, frame: UInt8Array) -> tuple[UInt8Array, tuple[Blob, ...]]:
    """Labels of the cylinder, and their blobs."""
    # The frame's own pixels are classified, as in training: `unwarp` mixes colours. On 60 frames of
    # the field this finds 8 % more landmarks, far ones, none wrong; the range errors of the others
    # have an rms of 1.2 %, of colours unwarped first 1.0.
    labels = unwarp_labels(label_image(detector.classifier, frame), detector.unwarp_map)
    return labels, blobs_from_labels(labels, min_pixels=MIN_BLOB_PIXELS)


def _make_detections(detector: Detector, candidates: Sequence[Candidate]) -> tuple[Detection, ...]:
    viewpoint = detector.view.viewpoint
    return tuple(detection_from_candidate(candidate, viewpoint) for candidate in candidates)


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
