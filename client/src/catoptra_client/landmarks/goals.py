"""Goals: one wide blob of one colour on the floor. A bearing, no range.

A goal's mouth, sides and back stand at ranges that differ by its depth, and which of them are seen
depends on where from: any single range would be wrong by decimetres without knowing it. The middle
of the blob's box is the bearing. Seen from the side it is drawn off the mouth's middle towards the
box behind it, by up to half the depth; the bearing's sigma says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from catoptra_client.landmarks.blobs import Blob
from catoptra_client.landmarks.candidates import Candidate, CylinderView
from catoptra_client.landmarks.detection import PolarMeasurement
from catoptra_client.landmarks.ranging import range_from_slope
from catoptra_protocol.landmarks import Landmark

# Sigma across the line of sight, as a share of the goal's depth. Measured in
# tests/client/landmarks/test_detector.py: from anywhere on the field the bearing's errors have an
# rms of 0.5 of the sigma, from 1 to 2 m beside the goal of 1.0.
LATERAL_SIGMA_FRACTION = 0.5
# The guess of the range lies between the mouth and the back, and between the posts.
RANGE_SIGMA_FRACTION = 0.5


def find_goal_candidates(
    view: CylinderView, landmark: Landmark, blobs: Sequence[Blob]
) -> list[Candidate]:
    """Return the blobs that this goal would look like, with a guess of the range.

    The guess is the range at which the blob's highest edge has the boards' height. It judges the
    size, and moves the bearing from the viewpoint to the robot's origin.
    """
    drop_m = view.drop_m(landmark, 1.0)
    found = []
    for blob in blobs:
        guess_m, below_or_above = range_from_slope(
            view.cylinder.slope_from_row(blob.top), drop_m=drop_m
        )
        looks_right = blob.colour == landmark.lower_colour and below_or_above
        if looks_right and _is_goal(view, landmark, blob, guess_m):
            sighting = _make_measurement(view, landmark, blob, guess_m)
            found.append(Candidate(landmark, (blob,), sighting, False))
    return found


def _is_goal(
    view: CylinderView, landmark: Landmark, blob: Blob, approximate_range_m: float
) -> bool:
    """Return whether a blob is as wide and high as a goal at this range, from some side.

    Narrowest along the mouth, where the depth shows; widest across the diagonal, and seen from
    within reach up to twice as wide. The boards' height is at least half seen; downwards the posts'
    feet, nearer than the back's top, add up to three times of it.
    """
    half_rad = 0.5 * blob.width * view.cylinder.azimuth_per_column_rad
    if half_rad >= 0.5 * math.pi:
        return False
    width_m = 2.0 * approximate_range_m * math.tan(half_rad)
    height_m = blob.height * view.cylinder.slope_per_row * approximate_range_m
    boards_m = landmark.band_top_m - landmark.band_bottom_m
    narrowest_m = 0.8 * min(landmark.depth_m, landmark.width_m)
    widest_m = 2.0 * math.hypot(landmark.width_m, landmark.depth_m)
    wide = narrowest_m <= width_m <= widest_m
    return wide and 0.5 * boards_m <= height_m <= 4.0 * boards_m


def _make_measurement(
    view: CylinderView, landmark: Landmark, blob: Blob, approximate_range_m: float
) -> PolarMeasurement:
    across = math.atan2(LATERAL_SIGMA_FRACTION * landmark.depth_m, approximate_range_m)
    sigma_rad = math.hypot(across, view.cylinder.azimuth_per_column_rad)
    azimuth = view.azimuth_from_column(0.5 * (blob.left + blob.right))
    return PolarMeasurement(
        approximate_range_m, azimuth, RANGE_SIGMA_FRACTION * approximate_range_m, sigma_rad
    )
