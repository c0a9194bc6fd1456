"""Displacement of edges by texels, searched by brute force in small images."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.frames.plan.error_bound import (
    MAX_EDGE_DISPLACEMENT_TEXELS,
    face_lookup_error,
    max_edge_displacement_texels,
)
from catoptra_server.frames.plan.faces import regions_of_size
from helpers.worlds import make_omni_camera

# Sixteenths of a texel: the standard patterns that Direct3D 11.1 prescribes and drivers share.
PATTERNS = {
    1: [(8, 8)],
    2: [(12, 12), (4, 4)],
    4: [(6, 2), (14, 6), (2, 10), (10, 14)],
    8: [(9, 5), (7, 11), (13, 9), (5, 3), (3, 13), (1, 7), (11, 15), (15, 1)],
}
EDGE_OFFSETS = np.linspace(0.0, 1.0, 17)


def displacement_texels(samples: int, middle: Floats, radius: float) -> float:
    """Distance from a disc's edge to the farthest point on the wrong side."""
    texel = np.arange(-math.ceil(radius + 2), math.ceil(radius + 3))
    points = (
        texel[:, None]
        + np.array(PATTERNS[samples]).T[:, None, :] / 16.0
        - 0.5
        - middle[:, None, None]
    )
    x, y = points
    covered = (np.hypot(x[:, None], y[None, :]) < radius).mean(axis=-1)
    corners = [covered[:-1, :-1], covered[1:, :-1], covered[:-1, 1:], covered[1:, 1:]]
    column, row = np.nonzero(np.ptp(corners, axis=0) > 0.0)
    c00, c10, c01, c11 = (corner[column, row][:, None, None] for corner in corners)
    u, v = EDGE_OFFSETS[:, None], EDGE_OFFSETS[None, :]
    light = (1 - v) * ((1 - u) * c00 + u * c10) + v * ((1 - u) * c01 + u * c11)
    at_x = texel[column][:, None, None] + u - middle[0]
    at_y = texel[row][:, None, None] + v - middle[1]
    inside = radius - np.hypot(at_x, at_y)
    wrong = ((light > 0.5 + 1e-9) & (inside < 0.0)) | ((light < 0.5 - 1e-9) & (inside > 0.0))
    return float(np.abs(inside[wrong]).max(initial=0.0))


@pytest.mark.parametrize("samples", PATTERNS)
def test_edges_are_displaced_nearly_up_to_the_bound(samples: int) -> None:
    rng = np.random.default_rng(samples)
    displaced = [
        displacement_texels(samples, rng.uniform(-0.5, 0.5, 2), radius)
        for radius in np.concatenate((rng.uniform(2.0, 2.3, 500), rng.uniform(2.3, 20.0, 100)))
    ]
    assert max(displaced) <= MAX_EDGE_DISPLACEMENT_TEXELS[samples] < 1.3 * max(displaced)


def test_untabulated_samples_count_as_the_next_lower() -> None:
    assert max_edge_displacement_texels(3) == max_edge_displacement_texels(2)
    assert max_edge_displacement_texels(32) == max_edge_displacement_texels(16)
    assert (
        max_edge_displacement_texels(1)
        > max_edge_displacement_texels(2)
        > max_edge_displacement_texels(4)
        > max_edge_displacement_texels(8)
    )


def test_error_is_half_a_texel_of_the_image_and_a_little() -> None:
    camera = make_omni_camera(width_px=360)
    error = face_lookup_error(camera, regions_of_size(camera.rim_rad, 365), face_samples=1)
    # One texel a pixel where there are fewest.
    assert 0.5 < error.max_px < 0.6
    assert error.max_deg == pytest.approx(math.degrees(max_edge_displacement_texels(1) * 2.0 / 365))
    assert 0.2 * error.max_px < error.rms_px < error.max_px / math.sqrt(3.0)
