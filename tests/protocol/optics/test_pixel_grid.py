"""Sample positions of pixels, and OpenCV's convention."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.image_plane import opencv_from_pixel, pixel_sample_positions
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera

IMAGE = PerspectiveCamera(4, 3, 1.0)


def test_pixel_centres_when_one_sample_are_at_half_pixels() -> None:
    grid = pixel_sample_positions(IMAGE)
    assert grid.shape == (3, 4, 1, 2)
    assert grid[0, 0, 0].tolist() == [0.5, 0.5]
    assert grid[2, 3, 0].tolist() == [3.5, 2.5]


def test_pixel_centres_when_sampled_are_a_regular_grid_around_the_centre() -> None:
    grid = pixel_sample_positions(IMAGE, samples_per_side=2)
    assert grid.shape == (3, 4, 4, 2)
    assert sorted(map(tuple, grid[1, 2])) == [
        (2.25, 1.25),
        (2.25, 1.75),
        (2.75, 1.25),
        (2.75, 1.75),
    ]
    np.testing.assert_allclose(grid.mean(axis=2), pixel_sample_positions(IMAGE)[:, :, 0])


def test_opencv_pixel_of_the_first_pixel_s_centre_is_0() -> None:
    np.testing.assert_array_equal(opencv_from_pixel(np.array([0.5, 0.5])), (0.0, 0.0))
