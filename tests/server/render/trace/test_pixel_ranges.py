from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.omni_camera import direction_from_pixel, pixel_sample_positions
from helpers.effect_measurement import CAMERA
from helpers.range_images import CAMERA_ABOVE_FLOOR, FLOOR, VIEWPOINT_HEIGHT_M, trace_ranges


def test_range_over_a_level_floor_is_that_of_the_camera_model() -> None:
    directions, on_mirror = direction_from_pixel(CAMERA, pixel_sample_positions(CAMERA)[..., 0, :])
    down = directions[..., 2]
    near = on_mirror & (down > 0.1)
    seen = trace_ranges(FLOOR, CAMERA_ABOVE_FLOOR)
    assert not np.isfinite(seen[~on_mirror | (down < 0.0)]).any()
    np.testing.assert_allclose(seen[near], VIEWPOINT_HEIGHT_M / down[near], rtol=1e-5)
