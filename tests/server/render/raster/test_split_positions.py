"""Split positions hold 48 bits."""

from __future__ import annotations

import numpy as np

from catoptra_server.render.raster.device import split_positions


def test_split_position_is_a_float32_number_and_what_it_lacks() -> None:
    positions = np.random.default_rng(3).uniform(-1e5, 1e5, (500, 3, 3))
    parts = split_positions(positions)
    assert parts.dtype == np.float32
    assert parts.shape == (500, 3, 6)
    assert np.array_equal(parts[..., :3], positions.astype(np.float32))
    whole = parts[..., :3].astype(np.float64) + parts[..., 3:]
    assert np.abs(whole - positions).max() < 1e5 * 2.0**-48


def test_difference_of_two_near_positions_is_as_exact_as_float32_can_hold_it() -> None:
    rng = np.random.default_rng(4)
    viewpoint = np.array((7.3e4, -9.9e4, 1.25))
    corners = viewpoint + rng.uniform(-0.02, 0.02, (500, 3))
    near, here = split_positions(corners), split_positions(viewpoint)
    # The shader's sum, float32 by float32.
    offsets = (near[:, :3] - here[:3]) + (near[:, 3:] - here[3:])
    assert offsets.dtype == np.float32
    # Three roundings of lengths below 4 cm.
    assert np.abs(offsets - (corners - viewpoint)).max() < 3 * 0.04 * 2.0**-24
