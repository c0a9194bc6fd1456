"""Beacons: two blobs stacked in a beacon's two colours, whose sizes and heights fit one range.

Range: rows are linear in y = (H - z) / r, so the lower band's centroid, at the height of its
middle, gives r without bias. The lower band, because it lies farther from the horizon than the
upper one, and because the lid, in the upper colour, is seen from above and would pull the upper
centroid up. What is seen is the front of the cylinder: over its width it is nearer than the axis by
radius * sqrt(1 - s^2), on average radius * pi / 4, which is added.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from catoptra_client.landmarks.blobs import Blob
from catoptra_client.landmarks.candidates import Candidate, CylinderView
from catoptra_client.landmarks.detection import PolarMeasurement
from catoptra_client.landmarks.ranging import (
    azimuth_sigma,
    incidence_angle_sigma,
    is_clear_of_horizon,
    range_from_slope,
    range_sigma,
)
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import angle_difference, interpolate_angle

# Sigma of a band's centroid, in pixels of the frame. Against exact frames the range errors have an
# rms of 0.4 (to 2 m) to 0.6 (at 3 m) of this; the rest is left to lights that differ from those of
# the training. Measured in tests/client/landmarks/test_detector.py.
CENTROID_SIGMA_PX = 0.2
# A range whose relative sigma exceeds this is none: the mean of 1 / y is then biased by sigma^2, 4
# %, and soon has no meaning at all.
MAX_RELATIVE_SIGMA = 0.2
# Which part of the front the labels cover is known to about a tenth of the radius.
FRONT_SIGMA_FRACTION = 0.1
# What is measured of a size may be smaller or larger than the range says by this ratio, and by as
# many rows or columns: of mixed pixels one at each border.
MAX_SIZE_RATIO, EDGE_TOLERANCE_PX = 2.0, 2.0


def find_beacon_candidates(
    view: CylinderView, landmark: Landmark, blobs: Sequence[Blob]
) -> list[Candidate]:
    """Return the pairs of blobs that this beacon would look like."""
    uppers = [blob for blob in blobs if blob.colour == landmark.upper_colour]
    found = []
    for lower in blobs:
        if lower.colour != landmark.lower_colour:
            continue
        front_m, below_or_above = _front_range(view, landmark, lower)
        if below_or_above and _is_band(view, landmark, lower, front_m):
            matches = [b for b in uppers if _is_upper_band(view, landmark, lower, b, front_m)]
            found += [_make_candidate(view, landmark, lower, upper, front_m) for upper in matches]
    return [candidate for candidate, has_bearing in found if has_bearing]


def _front_range(view: CylinderView, landmark: Landmark, lower: Blob) -> tuple[float, bool]:
    """Return the range of the lower band's front; invalid at the horizon or on its wrong side."""
    return range_from_slope(
        view.cylinder.slope_from_row(lower.row), drop_m=view.drop_m(landmark, 0.25)
    )


def _is_band(view: CylinderView, landmark: Landmark, blob: Blob, front_m: float) -> bool:
    """Return whether a blob has the size of one band at this range."""
    half_band_m = 0.5 * (landmark.band_top_m - landmark.band_bottom_m)
    rows = half_band_m / front_m / view.cylinder.slope_per_row
    radius_m = 0.5 * landmark.width_m
    width_rad = 2.0 * math.asin(radius_m / (front_m + radius_m))
    columns = width_rad / view.cylinder.azimuth_per_column_rad
    return _is_size_consistent(blob.height, rows) and _is_size_consistent(blob.width, columns)


def _is_size_consistent(measured: float, expected: float) -> bool:
    low, high = (
        expected / MAX_SIZE_RATIO - EDGE_TOLERANCE_PX,
        expected * MAX_SIZE_RATIO + EDGE_TOLERANCE_PX,
    )
    return low <= measured <= high


def _is_upper_band(
    view: CylinderView, landmark: Landmark, lower: Blob, upper: Blob, front_m: float
) -> bool:
    """Return whether `upper` stands on `lower` as the upper band does at this range."""
    if upper.row >= lower.row or not _is_band(view, landmark, upper, front_m):
        return False
    aside = abs(_azimuth_offset(view, lower, upper)) / view.cylinder.azimuth_per_column_rad
    expected_row = view.cylinder.row_from_slope(view.drop_m(landmark, 0.75) / front_m)
    off = abs(upper.row - expected_row)
    widest = max(lower.width, upper.width)
    return (
        aside <= 0.25 * widest + EDGE_TOLERANCE_PX
        and off <= 0.25 * lower.height + EDGE_TOLERANCE_PX
    )


def _azimuth_offset(view: CylinderView, lower: Blob, upper: Blob) -> float:
    """Return the azimuth from the lower to the upper centroid, across the seam too."""
    return angle_difference(
        view.azimuth_from_column(upper.column), view.azimuth_from_column(lower.column)
    )


def _make_candidate(
    view: CylinderView, landmark: Landmark, lower: Blob, upper: Blob, front_m: float
) -> tuple[Candidate, bool]:
    """Return the candidate, and whether it has a bearing at all.

    Without a range if that is too unsure or the lower band is cut off.
    """
    drop_m, radius_m = view.drop_m(landmark, 0.25), 0.5 * landmark.width_m
    axis_m = front_m + 0.25 * math.pi * radius_m
    along_m, sure = _axis_range_sigma(view, drop_m, front_m, radius_m)
    sure = sure and along_m <= MAX_RELATIVE_SIGMA * axis_m and not view.touches_edge(lower)
    across_rad, has_bearing = azimuth_sigma(
        view.camera, drop_m=drop_m, range_m=front_m, sigma_px=CENTROID_SIGMA_PX
    )
    share = upper.num_pixels / (upper.num_pixels + lower.num_pixels)
    azimuth = interpolate_angle(
        view.azimuth_from_column(lower.column),
        view.azimuth_from_column(upper.column),
        fraction=share,
    )
    sighting = PolarMeasurement(axis_m, azimuth, along_m, across_rad)
    return Candidate(landmark, (lower, upper), sighting, sure), has_bearing


def _axis_range_sigma(
    view: CylinderView, drop_m: float, front_m: float, radius_m: float
) -> tuple[float, bool]:
    """Return the sigma of the axis' range, and whether it is clear of the horizon.

    A range without a sigma is unsure by as much as itself.
    """
    place = {"drop_m": drop_m, "range_m": front_m, "sigma_px": CENTROID_SIGMA_PX}
    sigma_m, defined = range_sigma(view.camera, **place)
    if not defined:
        return front_m, False
    sigma_rad, _ = incidence_angle_sigma(view.camera, **place)
    clear = is_clear_of_horizon(drop_m=drop_m, range_m=front_m, sigma_rad=sigma_rad)
    return math.hypot(sigma_m, FRONT_SIGMA_FRACTION * radius_m), clear
