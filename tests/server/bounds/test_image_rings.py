from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import pixel_from_direction
from catoptra_server.effects.bounds.distances import (
    box_distance_bounds,
    image_rings,
    plane_distance_bounds,
)
from catoptra_server.effects.effect import NUM_RINGS
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera()
RING = image_rings(CAMERA)
EDGES = RING.edges_rad

metres = st.floats(-5.0, 5.0)
points = st.tuples(metres, metres, metres)


def ring_of(directions: Floats) -> Floats:
    """Ring of each (n, 3) direction; NUM_RINGS outside the mirror's view."""
    theta = np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), directions[:, 2])
    return np.searchsorted(EDGES[1:], theta)


def test_rings_have_equal_widths_in_the_image() -> None:
    directions = np.stack((np.sin(EDGES), 0.0 * EDGES, np.cos(EDGES)), axis=-1)
    directions[-1] = (math.sin(EDGES[-1] - 1e-9), 0.0, math.cos(EDGES[-1] - 1e-9))
    pixels, _ = pixel_from_direction(CAMERA, directions)
    radius = np.linalg.norm(pixels - CAMERA.centre_px, axis=-1)
    assert np.diff(radius) == pytest.approx(np.full(NUM_RINGS, 100.0 / NUM_RINGS), abs=1e-6)


@given(points, points, st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=150)
def test_no_point_of_a_box_is_nearer_than_its_ring_bound(
    one: tuple[float, ...], other: tuple[float, ...], seed: int
) -> None:
    low, high = np.minimum(one, other), np.maximum(one, other)
    inside = np.random.default_rng(seed).uniform(low, high, (200, 3))
    bounds = np.append(box_distance_bounds(low[None], high[None], RING)[0], 0.0)
    assert (np.linalg.norm(inside, axis=-1) >= bounds[ring_of(inside)] - 1e-12).all()


@given(points, st.floats(0.01, 4.0), st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=150)
def test_no_point_behind_a_plane_is_nearer_than_its_ring_bound(
    normal: tuple[float, ...], distance: float, seed: int
) -> None:
    length = float(np.linalg.norm(normal))
    unit = np.array(normal) / length if length > 1e-3 else np.array((0.0, 0.0, 1.0))
    directions = np.random.default_rng(seed).normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    reached = directions @ unit
    seen = directions[reached > 1e-6]
    bounds = plane_distance_bounds(np.array([distance]), unit[2:], RING)[0]
    ring = ring_of(seen)
    seen_m = distance / reached[reached > 1e-6]
    assert (seen_m >= np.append(bounds, 0.0)[ring] * (1.0 - 1e-12)).all()


def test_floor_distance_follows_the_ring_angle() -> None:
    floor = np.array([[-50.0, -50.0, 0.6]]), np.array([[50.0, 50.0, 0.6]])
    bounds = box_distance_bounds(*floor, RING)[0]
    down = np.cos(EDGES[:-1])
    expected = np.where(down > 0.0, 0.6 / np.maximum(down, 1e-9), np.inf)
    # A box grows by 1e-5 of its farthest corner, which for this floor is 0.7 mm.
    assert bounds == pytest.approx(expected, rel=2e-3)


def test_small_box_is_bounded_in_its_own_ring_only() -> None:
    theta = 0.5 * (EDGES[3] + EDGES[4])
    point = 2.0 * np.array([[0.0, math.sin(theta), math.cos(theta)]])
    bounds = box_distance_bounds(point - 0.01, point + 0.01, RING)[0]
    assert np.flatnonzero(np.isfinite(bounds)).tolist() == [3]
    assert bounds[3] == pytest.approx(1.99, abs=0.01)


def test_box_around_the_viewpoint_has_distance_zero_in_every_ring() -> None:
    bounds = box_distance_bounds(np.array([[-1.0, -1.0, -1.0]]), np.array([[1.0, 2.0, 0.5]]), RING)
    assert bounds.tolist() == [[0.0] * NUM_RINGS]


def test_plane_perhaps_behind_the_viewpoint_bounds_nothing() -> None:
    assert plane_distance_bounds(np.zeros(1), np.zeros(1), RING).tolist() == [[0.0] * NUM_RINGS]


def test_floor_as_a_plane_is_infinitely_far_above_the_horizon() -> None:
    bounds = plane_distance_bounds(np.array([0.6]), np.array([1.0]), RING)[0]
    assert np.isinf(bounds[EDGES[:-1] > 0.5 * math.pi + 1e-3]).all()
    assert bounds[0] == pytest.approx(0.6, rel=1e-4)
