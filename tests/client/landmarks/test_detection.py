"""Detections: from the viewpoint to the robot's origin."""

from __future__ import annotations

import numpy as np

from catoptra_client.landmarks.blobs import Viewpoint
from catoptra_client.landmarks.candidates import (
    PolarMeasurement,
    bearing_detection_from_measurement,
    detection_from_measurement,
)

MEASUREMENT = PolarMeasurement(2.0, 0.5, 0.1, 0.01)


def test_detection_without_an_offset_keeps_the_measurement() -> None:
    seen = detection_from_measurement(
        "l", "beacon", MEASUREMENT, viewpoint=Viewpoint(), num_pixels=9
    )
    assert (seen.range_m, seen.bearing_rad, seen.has_range) == (2.0, 0.5, True)
    np.testing.assert_allclose(seen.covariance, np.diag([0.01, 0.0001]))


def test_detection_with_an_offset_mixes_range_and_bearing() -> None:
    seen = detection_from_measurement(
        "l", "beacon", MEASUREMENT, viewpoint=Viewpoint(0.6, 0.0, 0.5), num_pixels=9
    )
    assert seen.covariance[0, 1] != 0.0
    assert np.linalg.eigvalsh(seen.covariance)[0] > 0.0


def test_bearing_alone_promises_no_range() -> None:
    seen = bearing_detection_from_measurement(
        "g", "goal", MEASUREMENT, viewpoint=Viewpoint(), num_pixels=9
    )
    assert (seen.range_m, seen.has_range) == (0.0, False)
    np.testing.assert_allclose(seen.covariance, np.diag([0.0, 0.0001]))


def test_bearing_alone_seen_off_centre_is_less_sure() -> None:
    vague = PolarMeasurement(2.0, 0.5, 1.0, 0.01)
    seen = bearing_detection_from_measurement(
        "g", "goal", vague, viewpoint=Viewpoint(0.6, 0.0, 0.3), num_pixels=9
    )
    assert seen.covariance[1, 1] > 0.0002
