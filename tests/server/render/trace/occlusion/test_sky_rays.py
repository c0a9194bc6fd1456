"""Directions to the sky: distributed by the cosine, and stratified in every set."""

from __future__ import annotations

import numpy as np

from catoptra_server.render.trace.occlusion.baking import (
    NUM_SETS,
    RADIUS_M,
    RAYS_PER_NODE,
    occluder_weights,
    sky_directions,
)


def test_directions_are_unit_and_above_the_surface() -> None:
    directions = sky_directions()
    assert directions.shape == (NUM_SETS, RAYS_PER_NODE, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-12)
    assert directions[..., 2].min() > 0.01


def test_every_set_is_distributed_by_the_cosine() -> None:
    # Under the cosine law the mean height is 2/3, and the horizontal parts cancel.
    means = sky_directions().mean(axis=1)
    np.testing.assert_allclose(means[:, 2], 2.0 / 3.0, atol=0.02)
    np.testing.assert_allclose(means[:, :2], 0.0, atol=0.06)


def test_sets_hold_equally_many_directions_in_every_sector() -> None:
    directions = sky_directions()
    sector = np.floor((np.arctan2(directions[..., 1], directions[..., 0]) + np.pi) / (np.pi / 4))
    for row in sector.astype(int):
        assert np.bincount(row, minlength=8).tolist() == [RAYS_PER_NODE // 8] * 8


def test_weight_falls_from_one_at_the_surface_to_zero_at_the_radius() -> None:
    distances = np.array([0.0, 0.5 * RADIUS_M, RADIUS_M, 2.0 * RADIUS_M, np.inf])
    assert occluder_weights(distances).tolist() == [1.0, 0.25, 0.0, 0.0, 0.0]
