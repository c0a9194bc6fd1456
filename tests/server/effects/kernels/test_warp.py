"""Warped images, rays of a displaced pinhole by Eq. 1, and speeds in the image."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import compute_image_scale, pixel_sample_positions
from catoptra_protocol.optics.mirrors import HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, pixel_from_direction
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.optics.transforms import rotation_from_rpy
from catoptra_server.effects import NUM_RINGS, SceneSummary
from catoptra_server.effects.bounds.distances import rotation_to_axis
from catoptra_server.effects.kernels.grey_levels import grey_level
from catoptra_server.effects.kernels.warp import (
    CameraPoseOffset,
    bound_motion,
    lookup_offsets_px,
    reflect_rays,
    ring_scales_and_radii,
    warp,
    warp_map_from_offsets,
)
from catoptra_server.render.trace.ray_caster import commit_to_reference
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Twist
from helpers.bilinear import sample_bilinear_at_offset
from helpers.motion_reference import displacements_px
from helpers.worlds import CAMERA_STATE, make_omni_camera, make_test_world

RNG = np.random.default_rng(3)
LIGHT = RNG.uniform(0.0, 2.0, (9, 12, 3))


def test_image_when_nothing_moves_keeps_every_bit() -> None:
    still = warp_map_from_offsets(np.zeros((9, 12, 2), dtype=np.float32))
    np.testing.assert_array_equal(warp(LIGHT, still), LIGHT)


@pytest.mark.parametrize("type_", [np.float32, np.float64])
def test_image_when_moved_by_whole_pixels_keeps_every_bit(type_: type) -> None:
    offset = np.zeros((9, 12, 2), dtype=np.float32)
    offset[...] = (3.0, -2.0)
    image = LIGHT.astype(type_)
    moved = warp(image, warp_map_from_offsets(offset))
    assert moved.dtype == type_
    np.testing.assert_array_equal(moved[2:, :-3], image[:-2, 3:])


def test_image_when_read_anywhere_is_the_resampled_one() -> None:
    offset = RNG.uniform(-15.0, 15.0, (9, 12, 2)).astype(np.float32)
    row, column = np.indices((9, 12))
    u_px, v_px = np.moveaxis(offset.astype(np.float64), -1, 0)
    # Weights are rounded to float32.
    expected = sample_bilinear_at_offset(LIGHT, column, row, offset_u_px=u_px, offset_v_px=v_px)
    np.testing.assert_allclose(warp(LIGHT, warp_map_from_offsets(offset)), expected, atol=2e-7)


def test_image_when_warped_is_left_alone() -> None:
    before = LIGHT.copy()
    warp(LIGHT, warp_map_from_offsets(np.full((9, 12, 2), 0.3, dtype=np.float32)))
    np.testing.assert_array_equal(LIGHT, before)


CAMERA = make_omni_camera(width_px=90)
PAPER = make_omni_camera(width_px=360)
PINHOLE_M = 0.2321
POSE_OFFSETS = (
    CameraPoseOffset((1e-3, 0.0, 0.0)),
    CameraPoseOffset((-4e-4, 7e-4, 2e-3)),
    CameraPoseOffset((0.0, 0.0, -5e-3)),
    CameraPoseOffset((2e-3, -1e-3, 1e-3), 4e-3, -6e-3),
    CameraPoseOffset((0.01, 0.01, -0.02), 0.02, 0.0),
)


def surface_residual(mirror: HyperbolicMirror, points: Floats) -> Floats:
    """Residual of Eq. 1 at (n, 3) points: 0 on the mirror, positive between both sheets."""
    x, y, z = points.T
    c, k = mirror.c_m, mirror.k
    height = 0.5 * c - z
    flat = (0.5 * k - 1.0) * (x * x + y * y) + 0.25 * c * c * (k - 2.0) / k
    return np.sqrt(flat) - height


def cast_rays(
    camera: OmniCamera, pose_offset: CameraPoseOffset, pixels: Floats
) -> tuple[Floats, ...]:
    """Points of (n, 2) pixels' rays on the mirror, reflected directions, distances from the axis.

    Of `CAMERA`: forward is up in the image.
    """
    mirror = camera.mirror
    assert isinstance(mirror, HyperbolicMirror)
    rim_r, rim_z = (float(part) for part in mirror.surface_point(np.array(camera.rim_t)))
    focal_px = camera.rim_radius_px * (PINHOLE_M - rim_z) / rim_r
    u, v = (pixels - np.asarray(camera.centre_px)).T
    straight = np.stack((-v, -u, np.full(len(u), -focal_px)), axis=-1) / focal_px
    turn = rotation_from_rpy(pose_offset.roll_rad, pose_offset.pitch_rad, 0.0)
    rays = straight @ turn.T
    pinhole = np.array([0.0, 0.0, PINHOLE_M]) + pose_offset.translation_m
    near, far = np.zeros(len(u)), np.full(len(u), 1.5 * PINHOLE_M)
    for _ in range(60):
        middle = 0.5 * (near + far)
        before = surface_residual(mirror, pinhole + middle[:, None] * rays) > 0.0
        near, far = np.where(before, middle, near), np.where(before, far, middle)
    hit = pinhole + near[:, None] * rays
    step = 1e-6 * np.eye(3)
    slope = np.stack(
        [surface_residual(mirror, hit + s) - surface_residual(mirror, hit - s) for s in step],
        axis=-1,
    )
    normal = slope / np.linalg.norm(slope, axis=-1, keepdims=True)
    on = rays - 2.0 * np.einsum("ni,ni->n", rays, normal)[:, None] * normal
    return hit, on / np.linalg.norm(on, axis=-1, keepdims=True), np.hypot(*hit.T[:2])


def all_pixel_centres(camera: OmniCamera) -> Floats:
    return pixel_sample_positions(camera).reshape(-1, 2)


@pytest.mark.parametrize("displacement", POSE_OFFSETS)
def test_rays_are_those_of_eq_1_with_normals_by_differencing(
    displacement: CameraPoseOffset,
) -> None:
    pixels = all_pixel_centres(CAMERA)
    point, on, axis_m = cast_rays(CAMERA, displacement, pixels)
    reflected = reflect_rays(CAMERA, displacement, pixels)
    rim_m = float(CAMERA.mirror.surface_point(np.array(CAMERA.rim_t))[0])
    certain = np.abs(axis_m - rim_m) > 1e-9
    np.testing.assert_array_equal(reflected.is_hit[certain], (axis_m < rim_m)[certain])
    hit = reflected.is_hit
    assert hit.mean() > 0.4
    np.testing.assert_allclose(reflected.point_m[hit], point[hit], atol=1e-12)
    unit = reflected.direction / np.linalg.norm(reflected.direction, axis=-1, keepdims=True)
    # Differences over a micrometre of numbers of some decimetres.
    np.testing.assert_allclose(unit[hit], on[hit], atol=1e-9)


def traced_lookup_px(pose_offset: CameraPoseOffset) -> tuple[Floats, Floats, Bools]:
    """Pixels, (n, 2), of the aligned camera for the displaced camera's view of a room.

    Then the distances of the points in view, and the validity: both cameras see the mirror.
    """
    point, on, axis_m = cast_rays(CAMERA, pose_offset, all_pixel_centres(CAMERA))
    caster = commit_to_reference(build_scene(make_test_world()))
    pose = CAMERA_STATE.world_from_mirror
    far = caster.distances(pose.transform_points(point), pose.rotate_directions(on))
    towards = np.where(np.isfinite(far)[:, None], point + np.minimum(far, 1e6)[:, None] * on, on)
    ideal, shown = pixel_from_direction(CAMERA, towards)
    rim_m = float(CAMERA.mirror.surface_point(np.array(CAMERA.rim_t))[0])
    distance = np.where(np.isfinite(far), np.linalg.norm(towards, axis=-1), np.inf)
    return ideal, distance, shown & (axis_m < rim_m)


@pytest.mark.parametrize("displacement", POSE_OFFSETS[:4])
def test_map_when_held_against_rays_is_off_by_no_more_than_parallax(
    displacement: CameraPoseOffset,
) -> None:
    ideal, distance_m, shown = traced_lookup_px(displacement)
    aside, valid, _ = lookup_offsets_px(CAMERA, displacement)
    both = shown & valid.ravel()
    assert both.sum() > 0.9 * valid.sum()
    off = np.linalg.norm(all_pixel_centres(CAMERA) + aside.reshape(-1, 2) - ideal, axis=-1)[both]
    # Largest distance of rays from the viewpoint over the range; 2 % more for the second order at
    # ranges of 0.3 m.
    miss_m = 0.19 * np.linalg.norm(displacement.translation_m)
    maximum = 1.02 * miss_m / distance_m[both] * compute_image_scale(CAMERA).max_px_per_rad
    assert np.isinf(distance_m[both]).any()
    assert distance_m[both].min() < 0.7
    assert (off <= maximum + 1e-6).all()


def displacement_px(pose_offset: CameraPoseOffset) -> Floats:
    aside, valid, _ = lookup_offsets_px(PAPER, pose_offset)
    return np.linalg.norm(aside, axis=-1)[valid]


def test_paper_s_image_when_the_pinhole_is_a_millimetre_off_moves_by_pixels() -> None:
    aside = displacement_px(CameraPoseOffset((1e-3, 0.0, 0.0)))
    assert aside.min() == pytest.approx(3.43, abs=0.01)
    assert aside.max() == pytest.approx(4.67, abs=0.01)
    assert displacement_px(CameraPoseOffset((0.0, 0.0, 1e-3))).max() == pytest.approx(
        0.567, abs=0.001
    )


@pytest.mark.parametrize(("offset_m", "most_px"), [((1e-3, 0, 0), 0.80), ((0, 0, 1e-3), 0.132)])
def test_paper_s_image_when_the_rim_is_put_back_is_off_by_less_than_a_pixel(
    offset_m: tuple[float, float, float], most_px: float
) -> None:
    # As a calibration by the rim's circle would: moved to the image centre, and to its old size.
    rim_z = float(PAPER.mirror.surface_point(np.array(PAPER.rim_t))[1])
    nearer = (PINHOLE_M - rim_z) / (PINHOLE_M + offset_m[2] - rim_z)
    focal_px = PAPER.rim_radius_px / float(PAPER.mirror.surface_point(np.array(PAPER.rim_t))[0])
    moved = np.array([0.0, focal_px * offset_m[0]])
    pixels = all_pixel_centres(PAPER)
    centre = np.asarray(PAPER.centre_px)
    inside = np.linalg.norm(pixels - centre, axis=-1) < PAPER.rim_radius_px - 0.1
    found = centre + moved + nearer * (pixels[inside] - centre)
    ideal, shown = pixel_from_direction(
        PAPER, reflect_rays(PAPER, CameraPoseOffset(offset_m), found).direction
    )
    off = np.linalg.norm(ideal - pixels[inside], axis=-1)[shown]
    assert off.max() == pytest.approx(most_px, abs=0.005)


def test_rays_when_the_pinhole_is_a_millimetre_off_pass_the_viewpoint_within_a_fifth() -> None:
    reflected = reflect_rays(PAPER, CameraPoseOffset((1e-3, 0.0, 0.0)), all_pixel_centres(PAPER))
    unit = reflected.direction / np.linalg.norm(reflected.direction, axis=-1, keepdims=True)
    miss_m = np.linalg.norm(np.cross(reflected.point_m, unit), axis=-1)[reflected.is_hit].max()
    assert miss_m == pytest.approx(0.189e-3, abs=1e-6)
    assert miss_m * compute_image_scale(PAPER).max_px_per_rad == pytest.approx(0.04, abs=5e-4)


@pytest.mark.parametrize(
    "mirror",
    [*(HyperbolicMirror(k, PINHOLE_M) for k in (3.0, 11.546, 1e3)), ParabolicMirror(0.03)],
    ids=["nearly flat", "of the paper", "far from its pinhole", "paraboloid"],
)
def test_camera_where_it_belongs_reads_every_pixel_where_it_is(
    mirror: HyperbolicMirror | ParabolicMirror,
) -> None:
    camera = make_omni_camera(mirror=mirror, width_px=90)
    aside, valid, _ = lookup_offsets_px(camera, CameraPoseOffset())
    radius = np.linalg.norm(all_pixel_centres(camera) - np.asarray(camera.centre_px), axis=-1)
    np.testing.assert_array_equal(valid.ravel(), radius <= camera.rim_radius_px)
    assert np.abs(aside).max() < 1e-10


def test_orthographic_camera_when_beside_its_axis_shows_the_same_moved() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03), width_px=90)
    aside, valid, _ = lookup_offsets_px(camera, CameraPoseOffset((0.0, 1e-3, 5e-3)))
    per_metre = camera.horizon_radius_px / 0.03
    # A ray parallel to the axis is reflected through the focus, wherever it meets the paraboloid.
    np.testing.assert_allclose(aside[valid], [(-1e-3 * per_metre, 0.0)] * valid.sum(), atol=1e-9)


def test_tilt_when_the_pinhole_stays_moves_the_image_by_the_focal_length() -> None:
    aside, valid, _ = lookup_offsets_px(PAPER, CameraPoseOffset(pitch_rad=1e-4))
    assert valid[180, 180]
    assert np.linalg.norm(aside[180, 180]) == pytest.approx(0.1086, abs=1e-4)


@pytest.mark.parametrize(("c_m", "maximum"), [(PINHOLE_M, 1.0), (0.02, 0.1)])
def test_pinhole_when_it_is_far_from_where_it_belongs_breaks_no_number(
    c_m: float, maximum: float
) -> None:
    camera = make_omni_camera(mirror=HyperbolicMirror(11.546, c_m), width_px=30)
    with np.errstate(all="raise", under="ignore"):
        aside, valid, kept = lookup_offsets_px(
            camera, CameraPoseOffset((0.02, -0.02, -0.05), 0.1, 0.1)
        )
    assert np.isfinite(aside).all()
    assert valid.mean() < maximum
    assert not aside[kept == 0.0].any()


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


def max_speeds_px_s(summary: SceneSummary, camera: RadialCamera) -> Floats:
    """Largest speed in each ring, by a motion of one second in that ring alone."""
    one_ring = np.eye(NUM_RINGS)
    return np.array([bound_motion(summary, camera, one).displacement_px for one in one_ring])


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


def test_motion_of_less_than_a_pixel_changes_a_sample_by_all_of_its_light() -> None:
    slow = SceneSummary(0.5, scene_twist=Twist(angular_rad_s=(0.0, 0.0, 2e-3)))
    bound = bound_motion(slow, CAMERAS["paper"], 1.0 / 30.0)
    assert 0.0 < bound.displacement_px < 0.01
    assert bound.value == grey_level(0.5)


def test_reason_when_nothing_moves_states_it() -> None:
    bound = bound_motion(SceneSummary(1.0, (1.0,) * NUM_RINGS), CAMERAS["paper"], 1.0)
    assert (bound.value, bound.reason) == (0.0, "nothing moves")
