from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.camera import (
    direction_from_pixel,
    pixel_centres,
    pixel_from_direction,
)
from catoptra_server.effects.capture import NOTHING_KNOWN, Capture, Geometry
from catoptra_server.effects.image_law import INNER, image_law
from catoptra_server.effects.image_motion import ImageMotion, motion_uniforms
from catoptra_server.render.staging import captured
from helpers.effects import CAMERA, CAPTURE, EXPOSURE, GEOMETRY
from helpers.motion import after

DOUBLE = np.dtype(np.float64)
EVERY = np.arange(CAMERA.width_px * CAMERA.height_px)
WHOLE = image_law(CAMERA).standing.reshape(-1) == INNER
DIRECTIONS = direction_from_pixel(CAMERA, pixel_centres(CAMERA)[..., 0, :])[0].reshape(-1, 3)
STEP_S = 1e-5


def seen_px(mover: int, range_m: float, time_s: float) -> np.ndarray:
    """Return (h w, 2): where the points that a mover has at a range all around are, at a time."""
    now, then = EXPOSURE, after(EXPOSURE, time_s)
    points = now.world_from_mirror.points(range_m * DIRECTIONS)
    if mover:
        was, is_ = (e.bodies[mover - 1].world_from_body for e in (now, then))
        points = is_.points(was.inverse().points(points))
    return pixel_from_direction(CAMERA, then.world_from_mirror.inverse().points(points))[0]


def flow(mover: int, range_m: float) -> np.ndarray:
    shape = (CAMERA.height_px, CAMERA.width_px)
    geometry = Geometry(
        np.full(shape, range_m, dtype=np.float32), np.full(shape, mover, dtype=np.float32)
    )
    capture = replace(captured(EXPOSURE), geometry=geometry)
    return ImageMotion(CAMERA, capture, DOUBLE).flow(EVERY, EVERY)


@pytest.mark.parametrize("mover", [0, 1])
@pytest.mark.parametrize("range_m", [0.3, 2.0, 1e6])
def test_flow_when_everything_moves_is_that_of_differences(mover: int, range_m: float) -> None:
    ahead, back = (seen_px(mover, range_m, t) for t in (STEP_S, -STEP_S))
    expected = ((ahead - back) / (2.0 * STEP_S)).T
    # Up to some hundred px/s, known to a part in 1e6: float32 maps.
    np.testing.assert_allclose(flow(mover, range_m)[:, WHOLE], expected[:, WHOLE], atol=2e-3)


def test_flow_when_nothing_is_met_is_that_of_the_turn_alone() -> None:
    np.testing.assert_allclose(flow(0, np.inf), flow(0, 1e12), atol=1e-6)


def test_spin_when_added_to_the_slide_is_the_flow() -> None:
    mover = GEOMETRY.mover
    nowhere = replace(CAPTURE, geometry=Geometry(np.full_like(mover, np.inf), mover))
    spin = ImageMotion(CAMERA, CAPTURE, DOUBLE).spin(EVERY, EVERY)
    far = ImageMotion(CAMERA, nowhere, DOUBLE).flow(EVERY, EVERY)
    np.testing.assert_allclose(spin, far, atol=1e-12)


def test_pixel_aside_when_beside_the_picture_is_the_same_one() -> None:
    motion = ImageMotion(CAMERA, CAPTURE, DOUBLE)
    middle = np.array([48 * 96 + 48])
    for aside, expected in (((2.4, -1.6), 46 * 96 + 50), ((0.0, 60.0), middle[0])):
        assert motion.shown_at(middle, np.array(aside)[:, None]) == expected


def test_uniforms_when_asked_again_bring_the_same_maps() -> None:
    one, other = (motion_uniforms(CAMERA, CAPTURE, 0.01) for _ in range(2))
    assert all(one[name] is other[name] for name in ("to_u", "to_v", "about_u", "standing"))
    assert one["twists"].shape == (2, 2, 3)


def test_motion_when_nothing_is_known_of_ranges_says_so() -> None:
    with pytest.raises(AssertionError, match="what each pixel sees"):
        ImageMotion(CAMERA, Capture(motion=NOTHING_KNOWN.motion), DOUBLE)
