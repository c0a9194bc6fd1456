from __future__ import annotations

import numpy as np

from catoptra_studies.camera_figures.polygon_figures import find_max_difference_window


def test_window_surrounds_what_differs_within_the_radius() -> None:
    reference = np.zeros((100, 100, 3), dtype=np.uint8)
    image = reference.copy()
    image[40:44, 60:64] = 200
    image[2:20, 2:20] = 255  # differs more, but beyond the radius

    row, column = find_max_difference_window(image, reference, 16, max_radius_px=40.0)

    assert row <= 40
    assert row + 16 >= 44
    assert column <= 60
    assert column + 16 >= 64
