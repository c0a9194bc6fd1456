"""Beacons: pairs of stacked blobs in a beacon's two colours, consistent with one range.

Range: rows are linear in y = (H - z) / r, so the centroid of the lower band, at the height of the
band's centre, gives r without bias. The upper band is not used, for two reasons: it lies nearer to
the horizon, and the lid, which has the upper colour and is visible from above, raises the centroid.
The blob shows the front of the cylinder, which is nearer than the axis by radius * sqrt(1 - s^2)
over the relative width s; the mean, radius * pi / 4, is added.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from catoptra_client.landmarks.blobs import Blob
from catoptra_client.landmarks.candidates import Candidate, CylinderView
from catoptra_client.landmarks.detection import PolarMeasurement
from catoptra_client.landmarks.ranging import (
    is_clear_of_horizon,
    range_from_slope,
    range_sigma_from_angle,
)
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import angle_difference, interpolate_angle

# Sigma of a band's centroid, in pixels of the frame. On exact frames the range errors have an rms
# of 0.4 (to 2 m) to 0.6 (at 3 m) of this sigma; the margin is for lights that differ from those in
# training. Measured in tests/client/landmarks/test_detector.py.
CENTROID_SIGMA_PX = 0.2
# Above this relative sigma no range is reported: the mean of 1 / y is biased by sigma^2, here 4 %,
# and diverges soon after.
MAX_RELATIVE_SIGMA = 0.2
# The labels cover the cylinder's front up to an unknown part of about a tenth of the radius.
FRONT_SIGMA_FRACTION = 0.1
# Tolerances of a blob's size against the size predicted from the range: a ratio, plus one mixed
# pixel at each of the two borders.
MAX_SIZE_RATIO, EDGE_TOLERANCE_PX = 2.0, 2.0


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
        expected / MAX_SIZE_RATIO - EDGE_TOLERANCE_PX,
        expected * MAX_SIZE_RATIO + EDGE_TOLERANCE_PX,
    )
    return low <= measured <= high


def _is_above(
    view: CylinderView, landmark: Landmark, lower: Blob, upper: Blob, front_m: float
) -> bool:
    """Whether `upper` stands on `lower` as the upper band does at this range."""
    if upper.row >= lower.row:
        return False
    column_offset = abs(_azimuth_offset(view, lower, upper)) / view.cylinder.azimuth_per_column_rad
    # 0.75: the centre of the upper half of the band.
    expected_row = view.cylinder.row_from_slope(view.drop_m(landmark, 0.75) / front_m)
    row_offset = abs(upper.row - expected_row)
    widest = max(lower.width, upper.width)
    return (
        column_offset <= 0.25 * widest + EDGE_TOLERANCE_PX
        and row_offset <= 0.25 * lower.height + EDGE_TOLERANCE_PX
    )


def _azimuth_offset(view: CylinderView, lower: Blob, upper: Blob) -> float:
    """Azimuth from the lower to the upper centroid, across the seam too."""
    return angle_difference(
        view.azimuth_from_column(upper.column), view.azimuth_from_column(lower.column)
    )


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
    angle_sigma_rad, azimuth_sigma_rad, has_bearing = view.angle_sigmas(
        azimuth, drop_m=drop_m, range_m=front_m, sigma_px=CENTROID_SIGMA_PX
    )
    range_sigma_m, clear_of_horizon = _axis_range_sigma(
        drop_m, front_m, radius_m, angle_sigma_rad if has_bearing else None
    )
    has_range = (
        clear_of_horizon
        and range_sigma_m <= MAX_RELATIVE_SIGMA * axis_m
        and not view.touches_edge(lower)
    )
    measurement = PolarMeasurement(axis_m, azimuth, range_sigma_m, azimuth_sigma_rad)
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
    return math.hypot(sigma_m, FRONT_SIGMA_FRACTION * radius_m), clear
