from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.camera import direction_from_pixel, pixel_centres
from helpers.effects import CAMERA
from helpers.ranges import ABOVE, EYE_M, FLOOR, traced


def test_range_when_over_a_level_floor_is_that_of_the_law() -> None:
    directions, on_mirror = direction_from_pixel(CAMERA, pixel_centres(CAMERA)[..., 0, :])
    down = directions[..., 2]
    near = on_mirror & (down > 0.1)
    seen = traced(FLOOR, ABOVE)
    assert not np.isfinite(seen[~on_mirror | (down < 0.0)]).any()
    np.testing.assert_allclose(seen[near], EYE_M / down[near], rtol=1e-5)
