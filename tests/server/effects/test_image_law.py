from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_centres,
    pixel_from_direction,
)
from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_server.effects.image_law import AT_RIM, BESIDE, INNER, WHOLE, image_law
from helpers.effects import CAMERA
from helpers.worlds import omni_camera

CAMERAS = {
    "paper": CAMERA,
    "odd width, a pixel on the axis": omni_camera(width_px=97),
    "turned": replace(CAMERA, up_azimuth_rad=0.7, centre_px=(45.3, 50.1)),
    "parabolic": omni_camera(mirror=ParabolicMirror(0.03), rim_deg=110.0, width_px=96),
}
STEP = 1e-6


def moved_px(camera: OmniCamera, turn: np.ndarray) -> np.ndarray:
    """Return (h, w, 2) px a unit that pixels move by when a (h, w, 3) step is added."""
    directions = direction_from_pixel(camera, pixel_centres(camera)[..., 0, :])[0]
    after = pixel_from_direction(camera, directions + STEP * turn)[0]
    before = pixel_from_direction(camera, directions - STEP * turn)[0]
    return (after - before) / (2.0 * STEP)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
def test_law_when_directions_change_is_that_of_differences(camera: OmniCamera) -> None:
    law = image_law(camera)
    whole = law.standing[..., 0] >= WHOLE
    directions = direction_from_pixel(camera, pixel_centres(camera)[..., 0, :])[0]
    for vector in np.random.default_rng(1).normal(size=(4, 3)):
        added = moved_px(camera, np.broadcast_to(vector, directions.shape))
        turned = moved_px(camera, np.cross(vector, directions))
        for axis, (to, about) in enumerate(((law.to_u, law.about_u), (law.to_v, law.about_v))):
            # float32: 100 px a radian, a part in 1e7.
            np.testing.assert_allclose((to @ vector)[whole], added[whole, axis], atol=1e-4)
            np.testing.assert_allclose((about @ vector)[whole], turned[whole, axis], atol=1e-4)


def test_standing_when_read_from_outside_to_the_axis_grows() -> None:
    row = image_law(CAMERA).standing[0, :, 0], image_law(CAMERA).standing[CAMERA.height_px // 2]
    assert (row[0][:40] == BESIDE).all()
    seen = row[1][: CAMERA.width_px // 2, 0]
    assert set(seen) == {AT_RIM, WHOLE, INNER}
    assert (np.diff(seen) >= 0.0).all()


@pytest.mark.parametrize("corner", [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)])
def test_pixel_when_whole_has_its_corners_on_the_mirror(corner: tuple[float, float]) -> None:
    standing = image_law(CAMERA).standing[..., 0]
    places = pixel_centres(CAMERA)[..., 0, :] + corner
    radius_px = np.linalg.norm(places - CAMERA.centre_px, axis=-1)
    assert radius_px[standing >= WHOLE].max() < CAMERA.rim_radius_px
    assert radius_px[standing == AT_RIM].max() > CAMERA.rim_radius_px


def test_beside_the_mirror_nothing_moves_and_the_maps_cannot_be_written() -> None:
    law = image_law(CAMERA)
    beside = law.standing[..., 0] == BESIDE
    assert beside.any()
    for chart in (law.to_u, law.to_v, law.about_u, law.about_v):
        assert not chart[beside].any()
        assert not chart.flags.writeable
    assert image_law(CAMERA) is law


def test_turn_about_the_axis_carries_by_angle_times_radius() -> None:
    law = image_law(CAMERA)
    off = pixel_centres(CAMERA)[..., 0, :] - CAMERA.centre_px
    inner = law.standing[..., 0] == INNER
    carried = np.hypot(law.about_u[..., 2], law.about_v[..., 2])
    np.testing.assert_allclose(carried[inner], np.hypot(*off[inner].T), rtol=1e-5)
    assert math.hypot(*off[inner].max(axis=0)) > 30.0
