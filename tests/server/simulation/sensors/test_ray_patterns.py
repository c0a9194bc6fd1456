"""Scans and cones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_server.simulation.sensors.ray_patterns import (
    beam_directions,
    clamp_ranges,
    cone_directions,
    scan_angles,
)


@pytest.mark.parametrize(
    ("fov_rad", "resolution_rad", "count"),
    [
        (math.pi, math.pi / 180.0, 181),
        (3.14159, 0.01745, 181),
        (3.14, 0.157, 21),
        (4.189, 0.0184, 228),
        (0.0, 1.0, 1),
    ],
)
def test_scan_of_a_real_scanner_has_its_beams(
    fov_rad: float, resolution_rad: float, count: int
) -> None:
    assert len(scan_angles(fov_rad, resolution_rad)) == count


def test_panning_scan_goes_from_right_to_left() -> None:
    angles = scan_angles(math.pi, math.pi / 180.0)
    beams = beam_directions(yaw_rad=angles, pitch_rad=0.0 * angles)
    np.testing.assert_allclose(beams[[0, 90, 180]], [[0, 1, 0], [1, 0, 0], [0, -1, 0]], atol=1e-12)


def test_tilting_scan_goes_from_above_to_below() -> None:
    angles = scan_angles(math.pi, math.pi / 180.0)
    beams = beam_directions(yaw_rad=0.0 * angles, pitch_rad=angles)
    np.testing.assert_allclose(beams[[0, 90, 180]], [[0, 0, -1], [1, 0, 0], [0, 0, 1]], atol=1e-12)


@pytest.mark.parametrize(("rings", "rays"), [(0, 8), (1, 4), (3, 8)])
def test_cone_stays_within_half_its_angle_and_reaches_it(rings: int, rays: int) -> None:
    directions = cone_directions(0.35, num_rings=rings, rays_per_ring=rays)
    off_axis = np.arccos(np.clip(directions[:, 0], -1.0, 1.0))
    assert len(directions) == 1 + rings * rays
    # arccos near 1 loses half the digits.
    assert off_axis.max() == pytest.approx(0.175 if rings else 0.0, abs=1e-7)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-15)


def test_limits_without_a_surface_read_the_maximum() -> None:
    assert clamp_ranges(np.array([0.01, 1.0, np.inf]), min_m=0.1, max_m=5.0).tolist() == [
        0.1,
        1.0,
        5.0,
    ]
