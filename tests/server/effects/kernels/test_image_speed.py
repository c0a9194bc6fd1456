from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.effects.bounds.distances import rotation_to_axis
from catoptra_server.effects.effect import NUM_RINGS, SceneSummary
from catoptra_server.effects.kernels.warp import (
    bound_motion,
    max_speeds_px_s,
    ring_scales_and_radii,
)
from catoptra_server.world.world_description import Twist
from helpers.motion_reference import displacements_px
from helpers.worlds import make_omni_camera

CAMERAS = {
    "paper": make_omni_camera(width_px=96),
    "wide picture": replace(make_omni_camera(width_px=96), width_px=130, centre_px=(60.0, 48.0)),
    "cropped": replace(make_omni_camera(width_px=96), height_px=60, centre_px=(48.0, 30.0)),
}
NEAREST_M = (0.6, 0.5, 0.7, 0.9, 1.5, 2.0, 3.0, math.inf)
MOTIONS = {
    "ahead": Twist((-0.5, 0.0, 0.0)),
    "turn": Twist(angular_rad_s=(0.0, 0.0, -1.0)),
    "both": Twist((-0.5, 0.2, 0.0), (0.0, 0.0, 1.0)),
    "falls and rolls": Twist((0.0, 0.1, -0.7), (0.8, -0.5, 0.2)),
}


# So short that displacements are straight, so long that they have digits in px.
_TIME_STEP_S = 1e-5


def measure_speeds(camera: OmniCamera, twist: Twist) -> tuple[Floats, Floats]:
    """Speed of each pixel, (h, w) px/s, at the summary's minimum distances, and its ring."""
    off = np.linalg.norm(pixel_sample_positions(camera)[..., 0, :] - camera.centre_px, axis=-1)
    ring = np.minimum((off / camera.rim_radius_px * NUM_RINGS).astype(np.intp), NUM_RINGS - 1)
    range_m = np.array(NEAREST_M)[ring]
    before, after = (
        displacements_px(camera, twist, range_m, np.array(t)) for t in (-_TIME_STEP_S, _TIME_STEP_S)
    )
    return np.nan_to_num(np.linalg.norm(after - before, axis=-1) / (2.0 * _TIME_STEP_S)), ring


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS.keys())
@pytest.mark.parametrize("twist", MOTIONS.values(), ids=MOTIONS.keys())
def test_speeds_when_a_scene_is_as_near_as_it_may_be_are_bounds_and_tight(
    camera: OmniCamera, twist: Twist
) -> None:
    bounds = max_speeds_px_s(SceneSummary(1.0, NEAREST_M, scene_twist=twist), camera)
    measured, ring = measure_speeds(camera, twist)
    assert (measured <= bounds[ring] * (1.0 + 1e-6) + 1e-6).all()
    assert bounds.max() < 1.7 * measured.max()


@pytest.mark.parametrize("fov_deg", [20.0, 90.0, 150.0])
@pytest.mark.parametrize("twist", MOTIONS.values(), ids=MOTIONS.keys())
def test_speeds_of_a_lens_s_pixels_are_within_their_bounds(fov_deg: float, twist: Twist) -> None:
    lens = PerspectiveCamera(96, 64, math.radians(fov_deg))
    pixels = pixel_sample_positions(lens)[:, :, 0]
    radius_px = np.linalg.norm(pixels - lens.centre_px, axis=-1)
    ring = np.minimum((radius_px / lens.rim_radius_px * NUM_RINGS).astype(np.intp), NUM_RINGS - 1)
    # Axes whose z is the optical axis, as those of the summary.
    camera_from_axes = rotation_to_axis(lens.optical_axis).T
    near_m = np.minimum(np.array(NEAREST_M)[ring], 1e9)[..., None]
    points = near_m * (lens.direction_from_pixel(pixels)[0] @ camera_from_axes)
    velocity = np.array(twist.linear_m_s) + np.cross(twist.angular_rad_s, points)
    moved, valid = lens.pixel_from_direction(
        (points + _TIME_STEP_S * velocity) @ camera_from_axes.T
    )
    speed = np.linalg.norm(moved - pixels, axis=-1)[valid] / _TIME_STEP_S
    bounds = max_speeds_px_s(SceneSummary(1.0, NEAREST_M, scene_twist=twist), lens)
    assert (speed <= bounds[ring[valid]] * (1.0 + 1e-3) + 1e-6).all()
    assert bounds.max() < 2.5 * speed.max()


def test_passing_bodies_when_they_come_add_their_rate() -> None:
    camera = CAMERAS["paper"]
    rates = (0.0,) * 5 + (0.4, 0.0, 0.0)
    speeds = max_speeds_px_s(SceneSummary(1.0, max_object_rates_rad_s=rates), camera)
    assert np.flatnonzero(speeds).tolist() == [5]
    assert speeds[5] == pytest.approx(0.4 * ring_scales_and_radii(camera)[0][5])


def test_reference_camera_when_it_drives_past_a_wall_has_the_known_blur() -> None:
    # With a rim of 180 px: 8 mm in front of pixels of 7.4 um.
    camera = make_omni_camera(width_px=360)
    wall = SceneSummary(1.0, (1.0,) * NUM_RINGS, scene_twist=Twist((-0.5, 0.0, 0.0)))
    assert bound_motion(wall, camera, 1.0 / 30.0).displacement_px == pytest.approx(3.5, abs=0.1)
    turn = SceneSummary(1.0, scene_twist=Twist(angular_rad_s=(0.0, 0.0, math.radians(60.0))))
    assert bound_motion(turn, camera, 1.0 / 30.0).displacement_px == pytest.approx(6.28, abs=0.01)


def test_reason_when_something_moves_names_speed_range_turn_and_time() -> None:
    twist = Twist((-0.5, 0.0, 0.0), (0.0, 0.0, math.radians(60.0)))
    summary = SceneSummary(
        1.0, (1.0,) * NUM_RINGS, scene_twist=twist, max_object_rates_rad_s=(0.5,) * NUM_RINGS
    )
    reason = bound_motion(summary, CAMERAS["paper"], 1.0 / 30.0).reason
    for part in ("0.5 m/s at 1 m", "turns by up to 60 degrees/s", "29 degrees/s", "33.3 ms"):
        assert part in reason


def test_reason_when_nothing_moves_states_it() -> None:
    bound = bound_motion(SceneSummary(1.0, (1.0,) * NUM_RINGS), CAMERAS["paper"], 1.0)
    assert (bound.value, bound.reason) == (0.0, "nothing moves")
