"""Circles of confusion against rays that are traced through lens and mirror."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.elementary import hypot
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.effects import NUM_RINGS, SceneSummary
from catoptra_server.effects.kernels.lens_blur import (
    Aperture,
    CircleOfConfusion,
    circle_of_confusion,
    circle_of_confusion_map,
    describe_lens,
    interior_mask,
    map_of_radius,
    max_diameter_px,
    min_distance_at_radius,
    sample_radii_px,
    virtual_image_depth_m,
)
from helpers.lens_ray_tracer import Quadric
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=360)
# 8 mm focused at 268 mm has its image at 8.246 mm: in pixels of 7.4 um.
PITCH_M = 7.4e-6
EIGHT_MM_LENS_CAMERA = make_omni_camera(width_px=360)
EIGHT_MM_LENS_CAMERA = replace(
    EIGHT_MM_LENS_CAMERA,
    scale_px=EIGHT_MM_LENS_CAMERA.scale_px
    * EIGHT_MM_LENS_CAMERA.inverse_focal_length
    / (1.0 / 8e-3 - 1.0 / 0.26812)
    / PITCH_M,
)
TELECENTRIC = make_omni_camera(mirror=ParabolicMirror(0.03), width_px=360, rim_deg=110.0)


def lens(f_number: float, focus_m: float = 0.0) -> Aperture:
    return Aperture(f_number, PITCH_M, focus_m)


def infinity_diameters_px(aperture: Aperture, camera: OmniCamera) -> Floats:
    return np.abs(
        circle_of_confusion(aperture, camera, sample_radii_px(camera)).infinity_diameter_px
    )


def test_focal_length_when_focused_is_that_of_the_lens_which_makes_the_image() -> None:
    focal_m = 1.0 / (
        EIGHT_MM_LENS_CAMERA.inverse_focal_length / PITCH_M
        + lens(4.0).focus_coordinate(EIGHT_MM_LENS_CAMERA)
    )
    assert focal_m == pytest.approx(8e-3, rel=1e-4)


@pytest.mark.parametrize("centre_px", [(180.0, 180.0), (170.25, 193.0)])
def test_map_of_radius_has_the_value_of_each_pixels_own_radius(
    centre_px: tuple[float, float],
) -> None:
    camera = replace(CAMERA, centre_px=centre_px)
    got = map_of_radius(camera, lambda r: np.stack((r, np.cos(r)), axis=-1))
    offset = pixel_sample_positions(camera)[:, :, 0] - centre_px
    radius_px = hypot(offset[..., 0], offset[..., 1])
    np.testing.assert_array_equal(got, np.stack((radius_px, np.cos(radius_px)), axis=-1))


@pytest.mark.parametrize(("f_number", "disc_px"), [(2.0, 2.54), (4.0, 1.27), (8.0, 0.634)])
def test_disc_of_infinity_when_focused_best_is_that_of_an_8_mm_lens(
    f_number: float, disc_px: float
) -> None:
    # (f^2 / N) / (pitch (Z_f - f)) |Z - Z_f| / Z at Z = 316.4 and 232.6 mm.
    assert infinity_diameters_px(lens(f_number), EIGHT_MM_LENS_CAMERA).max() == pytest.approx(
        disc_px, abs=0.006
    )


@pytest.mark.parametrize(
    ("distance_m", "added_px"), [(0.1, 1.08), (0.3, 0.463), (1.0, 0.154), (math.inf, 0.0)]
)
def test_disc_of_what_is_near_differs_from_infinitys(distance_m: float, added_px: float) -> None:
    radius = sample_radii_px(EIGHT_MM_LENS_CAMERA)
    t = EIGHT_MM_LENS_CAMERA.projection.t_from_radius_ratio(
        radius / EIGHT_MM_LENS_CAMERA.horizon_radius_px
    )
    rho_m = np.hypot(*EIGHT_MM_LENS_CAMERA.mirror.surface_point(t))
    added = circle_of_confusion(lens(2.0), EIGHT_MM_LENS_CAMERA, radius).near_term_px(
        rho_m + distance_m
    )
    assert added.max() == pytest.approx(added_px, abs=0.006)


def test_lens_when_focused_at_the_scene_spreads_what_the_mirror_shows_over_16_px() -> None:
    # 8 mm lens, 360 px image: (f / N) f_px (1 / 0.2326 m - 1 / 2 m).
    assert infinity_diameters_px(lens(2.0, 2.0), CAMERA).max() == pytest.approx(16.5, abs=0.1)


def test_focus_when_best_is_268_mm_and_no_other_has_a_smaller_largest_disc() -> None:
    assert 1.0 / lens(4.0).focus_coordinate(CAMERA) == pytest.approx(0.26812, abs=1e-5)
    best = infinity_diameters_px(lens(4.0), CAMERA).max()
    for focus_m in (0.24, 0.266, 0.270, 0.3):
        assert infinity_diameters_px(lens(4.0, focus_m), CAMERA).max() > best


@pytest.mark.parametrize("rim_share", [0.0, 0.3, 0.57, 1.0])
@pytest.mark.parametrize("distance_m", [0.05, 0.3, 2.0, math.inf])
def test_virtual_image_when_rays_are_traced_lies_where_they_meet(
    rim_share: float, distance_m: float
) -> None:
    """In the plane of the axis and across: without astigmatism both agree."""
    t = np.array([max(rim_share, 1e-3) * CAMERA.rim_t])
    expected = virtual_image_depth_m(CAMERA, t, np.array(distance_m))
    for turn in (np.array((1.0, 0.0, 0.0)), np.array((0.0, 1.0, 0.0))):
        depth = trace_depth_m(float(t[0]), distance_m, turn)
        assert depth == pytest.approx(float(expected[0]), rel=2e-5)


def trace_depth_m(t: float, distance_m: float, ray_offset: Floats) -> float:
    """Depth at which the reflections of two neighbouring rays of a point intersect."""
    (r,), (z,) = PAPER_MIRROR.surface_point(np.array([t]))
    mirror, pinhole = (
        Quadric.from_mirror(PAPER_MIRROR),
        np.array((0.0, 0.0, PAPER_MIRROR.pinhole_distance_m)),
    )
    point = np.array((r, 0.0, z))
    outward = point / np.linalg.norm(point)
    half_m = 1e-4 * ray_offset
    if math.isinf(distance_m):
        starts = [point + 0.1 * outward + sign * half_m for sign in (1.0, -1.0)]
        ways = [-outward, -outward]
    else:
        starts = [point + distance_m * outward] * 2
        ways = [point + sign * half_m - starts[0] for sign in (1.0, -1.0)]
    hit = mirror.intersect(np.array(starts), np.array(ways))
    normal = mirror.normal(hit)
    direction = np.array(ways) / np.linalg.norm(ways, axis=1, keepdims=True)
    away = direction - 2.0 * (direction * normal).sum(axis=1, keepdims=True) * normal
    return float(pinhole[2] - closest_approach_height(hit, away))


def closest_approach_height(start: Floats, direction: Floats) -> float:
    """Height of the midpoint between two lines at their closest approach."""
    across = direction[0] @ direction[1]
    apart = start[1] - start[0]
    first, second = apart @ direction[0], apart @ direction[1]
    scale = 1.0 - across * across
    along = np.array(((first - across * second) / scale, (across * first - second) / scale))
    return float((start + along[:, None] * direction)[:, 2].mean())


def test_orthographic_lens_when_focused_best_spreads_by_the_depth_of_the_image() -> None:
    # At infinity the image of a paraboloid lies r^2 / p below the focus: here over 61 mm.
    p, r = 0.03, 0.03 * math.tan(math.radians(55.0))
    magnification = PITCH_M * TELECENTRIC.rim_radius_px / r
    expected = magnification**2 / 4.0 * (0.5 * r * r / p) / PITCH_M
    assert infinity_diameters_px(lens(4.0), TELECENTRIC).max() == pytest.approx(expected, rel=1e-9)
    assert "telecentric" in describe_lens(lens(4.0, 0.5), TELECENTRIC)
    np.testing.assert_array_equal(
        infinity_diameters_px(lens(4.0, 0.5), TELECENTRIC),
        infinity_diameters_px(lens(4.0), TELECENTRIC),
    )


def test_orthographic_lens_when_a_thing_is_near_sees_it_as_a_mirror_of_power_1_over_rho() -> None:
    circle = circle_of_confusion(lens(4.0), TELECENTRIC, sample_radii_px(TELECENTRIC))
    t = TELECENTRIC.mirror.t_from_radius_ratio(
        sample_radii_px(TELECENTRIC) / TELECENTRIC.horizon_radius_px
    )
    rho = np.hypot(*TELECENTRIC.mirror.surface_point(t))
    gain = PITCH_M / 4.0 * (TELECENTRIC.horizon_radius_px / 0.03) ** 2
    # 1/s' = 1/D + 1/rho; infinity's is at rho.
    nearer = rho - 1.0 / (1.0 / (0.2 - rho) + 1.0 / rho)
    np.testing.assert_allclose(circle.near_term_px(np.array(0.2)), gain * nearer, rtol=1e-9)


@pytest.mark.parametrize("camera", [CAMERA, TELECENTRIC])
def test_largest_disc_of_all_is_that_of_what_touches_the_mirror(camera: OmniCamera) -> None:
    circle = circle_of_confusion(lens(2.0), camera, sample_radii_px(camera))
    for range_m in (0.08, 0.2, 1.0, math.inf):
        assert circle.diameter_px(np.array(range_m)).max() <= max_diameter_px(lens(2.0), camera)


def test_range_within_the_mirror_has_a_finite_disc() -> None:
    circle = circle_of_confusion(lens(2.0), CAMERA, sample_radii_px(CAMERA))
    assert np.isfinite(circle.diameter_px(np.array(0.0))).all()


def test_discs_of_pixels_are_those_of_their_radius_and_beyond_the_rim_the_rims() -> None:
    circle = circle_of_confusion_map(lens(2.0), CAMERA)
    at_rim = circle_of_confusion(
        lens(2.0), CAMERA, np.array([CAMERA.rim_radius_px])
    ).infinity_diameter_px[0]
    assert circle.infinity_diameter_px[0, 0] == at_rim
    there = circle_of_confusion(
        lens(2.0), CAMERA, np.array([math.hypot(0.5, 100.5)])
    ).infinity_diameter_px[0]
    assert circle.infinity_diameter_px[180, 280] == pytest.approx(there, rel=1e-12)


def test_corners_of_whole_pixels_are_all_on_the_mirror() -> None:
    whole = interior_mask(CAMERA)
    v, u = np.nonzero(whole)
    corners = [np.hypot(u + a - 180.0, v + b - 180.0).max() for a in (0, 1) for b in (0, 1)]
    assert max(corners) <= CAMERA.rim_radius_px
    assert whole.mean() > 0.77


def test_nearest_when_a_radius_lies_on_a_border_of_rings_is_the_nearer_of_both() -> None:
    nearest = tuple(1.0 + index for index in range(NUM_RINGS))[::-1]
    summary = SceneSummary(1.0, min_distances_m=nearest)
    radius = CAMERA.rim_radius_px * np.array((0.0, 0.06, 0.125, 0.13, 1.0))
    np.testing.assert_array_equal(
        min_distance_at_radius(summary, CAMERA, radius), (8.0, 8.0, 7.0, 7.0, 1.0)
    )


PLAIN_CAMERA = PerspectiveCamera(640, 480, math.radians(40.0))


def traced_diameter_px(aperture: Aperture, range_m: float, radius_px: float) -> float:
    """Disc of a point at a range and an image radius, by similar triangles behind the lens."""
    image_m = PLAIN_CAMERA.focal_length_px * PITCH_M
    focus = 1.0 / aperture.focus_distance_m if aperture.focus_distance_m else 0.0
    focal_m = 1.0 / (1.0 / image_m + focus)
    depth_m = range_m * math.cos(math.atan(radius_px * PITCH_M / image_m))
    # The point's own image, and the width of its cone of light at the sensor.
    own_image_m = 1.0 / (1.0 / focal_m - 1.0 / depth_m)
    return (
        focal_m
        / aperture.f_number
        * abs(image_m - own_image_m)
        / own_image_m
        / aperture.pixel_pitch_m
    )


@pytest.mark.parametrize("focus_m", [0.0, 0.5, 2.0])
@pytest.mark.parametrize("radius_px", [0.0, 250.0, 400.0])
@pytest.mark.parametrize("range_m", [0.3, 1.0, 2.0, 50.0])
def test_disc_of_a_point_is_that_of_traced_rays(
    focus_m: float, radius_px: float, range_m: float
) -> None:
    aperture = Aperture(2.8, PITCH_M, focus_m)
    circle = circle_of_confusion(aperture, PLAIN_CAMERA, np.array(radius_px))
    traced = traced_diameter_px(aperture, range_m, radius_px)
    assert float(circle.diameter_px(np.array(range_m))) == pytest.approx(traced, rel=1e-9)


def test_disc_at_the_hyperfocal_distance_of_infinity_is_one_pixel() -> None:
    aperture = Aperture(2.8, PITCH_M, 0.0)
    focal_px = PLAIN_CAMERA.focal_length_px
    hyperfocal_m = focal_px * PITCH_M / 2.8 * focal_px
    circle = circle_of_confusion(aperture, PLAIN_CAMERA, np.array(0.0))
    assert float(circle.diameter_px(np.array(hyperfocal_m))) == pytest.approx(1.0, rel=1e-12)
    assert float(circle.diameter_px(np.array(math.inf))) == 0.0


def test_focus_coordinate_of_no_distance_is_infinity() -> None:
    assert Aperture(4.0, PITCH_M, 0.0).focus_coordinate(PLAIN_CAMERA) == 0.0
    assert Aperture(4.0, PITCH_M, 0.5).focus_coordinate(PLAIN_CAMERA) == 2.0


def test_lens_is_described_with_its_focus() -> None:
    assert describe_lens(Aperture(4.0, PITCH_M, 0.0), PLAIN_CAMERA) == "F/4, focused at infinity"
    assert describe_lens(Aperture(4.0, PITCH_M, 1.5), PLAIN_CAMERA) == "F/4, focused at 1.5 m"


def test_every_pixel_of_a_lens_is_interior() -> None:
    assert interior_mask(PLAIN_CAMERA).all()


CIRCLE = CircleOfConfusion(np.array(-2.0), np.array(3.0), np.array(1.0), np.array(0.5))


def test_disc_shrinks_to_a_point_at_the_focus_and_grows_behind() -> None:
    # -2 + 3 / (D + 1/2) vanishes at D = 1.
    assert CIRCLE.diameter_px(np.array([0.5, 1.0, math.inf])).tolist() == [1.0, 0.0, 2.0]


def test_near_term_of_an_object_in_the_mirror_is_finite() -> None:
    assert np.isfinite(CIRCLE.near_term_px(np.array(-0.5)))
