"""Goals: one wide blob of one colour on the floor. A bearing, no range.

Mouth, sides and back of a goal stand at ranges that differ by the depth, and the visible ones
depend on the robot's position: any single range could be wrong by decimetres. The bearing is the
centre of the blob's box. From the side that centre shifts from the centre of the mouth towards the
box behind, by up to half the depth, which the sigma of the bearing covers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from catoptra_client.landmarks.blobs import Blob
from catoptra_client.landmarks.candidates import Candidate, CylinderView
from catoptra_client.landmarks.detection import PolarMeasurement
from catoptra_client.landmarks.ranging import range_from_slope
from catoptra_protocol.landmarks import Landmark

# Sigma across the line of sight, as a fraction of the goal's depth. Over the whole field the errors
# of the bearing have an rms of 0.5 sigma, 1 to 2 m beside the goal of 1.0 sigma. Measured in
# tests/client/landmarks/test_detector.py.
LATERAL_SIGMA_FRACTION = 0.5
# The approximate range lies between mouth and back, and between the posts.
RANGE_SIGMA_FRACTION = 0.5


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
    lateral_rad = math.atan2(LATERAL_SIGMA_FRACTION * landmark.depth_m, approximate_range_m)
    sigma_rad = math.hypot(lateral_rad, view.cylinder.azimuth_per_column_rad)
    azimuth = view.azimuth_from_column(0.5 * (blob.left + blob.right))
    return PolarMeasurement(
        approximate_range_m, azimuth, RANGE_SIGMA_FRACTION * approximate_range_m, sigma_rad
    )
