"""Properties of the camera models: round trips, order, symmetry, continuity at branches.

Hypothesis chooses a mirror and a seed, numpy some hundred samples from that seed: 100 examples are
tens of thousands of samples. A failure prints mirror and seed.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, note, settings
from hypothesis import strategies as st

from catoptra_protocol.optics.cube_map import (
    MIRROR_FROM_FACE_ROTATIONS,
    face_coordinates,
    face_from_direction,
)
from catoptra_protocol.optics.mirrors import HyperbolicMirror, Mirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Floats, half_angle_tangent
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    camera_with_inscribed_rim,
    direction_from_pixel,
    pixel_from_direction,
)
from catoptra_protocol.usarsim.value_format import (
    format_exact,
    format_fixed_point,
    number_from_text,
)

PROPERTY = settings(derandomize=True, max_examples=100, deadline=None)
PLACES = 400
EPS = float(np.finfo(np.float64).eps)
EPS32 = float(np.finfo(np.float32).eps)

seeds = st.integers(0, 2**31)
# k from next to a plane to next to a paraboloid, evenly in the exponent of k - 2.
ks = st.floats(-12.0, 15.0).map(lambda exponent: 2.0 + 10.0**exponent)


def incidence_tangents(seed: int, k: float) -> tuple[HyperbolicMirror, Floats]:
    """Mirror and sorted t from the axis to just before its asymptote."""
    note(f"k = {k!r}, seed = {seed}")
    mirror = HyperbolicMirror(k, 0.2)
    rng = np.random.default_rng(seed)
    # Half of them evenly in the angle, half in the exponent, so that the axis is not forgotten.
    angle = rng.uniform(0.0, math.atan(mirror.t_limit) * (1.0 - 1e-6), PLACES // 2)
    tiny = 10.0 ** rng.uniform(-300.0, 0.0, PLACES // 2) * 0.99
    return mirror, np.sort(np.concatenate((np.tan(angle), tiny)))


def some_camera(seed: int, k: float) -> tuple[OmniCamera, np.random.Generator]:
    """Camera of any size, rim, centre and turn, and the generator of its samples."""
    note(f"k = {k!r}, seed = {seed}")
    rng = np.random.default_rng(seed)
    mirror: Mirror = HyperbolicMirror(k, 0.2) if seed % 4 else ParabolicMirror(0.05)
    # No nearer to the antipode than 150 degrees, where a radian is a thousandth of a pixel.
    highest = min(2.0 * math.atan(mirror.t_limit), math.radians(150.0))
    camera = camera_with_inscribed_rim(
        mirror,
        width_px=int(rng.integers(1, 4096)),
        height_px=int(rng.integers(1, 4096)),
        rim_rad=highest * float(rng.uniform(0.05, 0.999)),
        image_up_azimuth_rad=float(rng.uniform(-4.0, 4.0)),
    )
    return camera, rng


@PROPERTY
@given(seeds, ks)
def test_t_when_sent_to_a_radius_and_back_is_the_same(seed: int, k: float) -> None:
    mirror, t = incidence_tangents(seed, k)
    back = mirror.t_from_radius_ratio(mirror.radius_ratio_from_t(t))
    np.testing.assert_allclose(back, t, rtol=24.0 * EPS, atol=0.0)


@PROPERTY
@given(seeds, ks)
def test_radius_when_t_grows_never_falls(seed: int, k: float) -> None:
    mirror, t = incidence_tangents(seed, k)
    # Neighbours an ulp apart too: rounding may keep a radius, by an ulp or two it may fall back.
    both = np.sort(np.concatenate((t, np.nextafter(t, math.inf))))
    ratio = mirror.radius_ratio_from_t(both)
    assert (np.diff(ratio) >= -8.0 * EPS * ratio[1:]).all()
    assert (np.diff(mirror.radius_ratio_from_t(t))[np.diff(t) > 1e-6 * t[1:]] > 0.0).all()


@PROPERTY
@given(seeds, ks)
def test_surface_when_reflected_looks_at_the_pinhole(seed: int, k: float) -> None:
    mirror, t = incidence_tangents(seed, k)
    r, z = mirror.surface_point(t)
    to_viewpoint, to_pinhole = np.hypot(r, z), np.hypot(r, mirror.pinhole_distance_m - z)
    # 2a = |M - p| - |M - v| for every point of the mirror: the hyperbola's own definition.
    axis_m = mirror.c_m * math.sqrt((k - 2.0) / k)
    reach = np.maximum(to_viewpoint, to_pinhole)
    assert (np.abs(to_pinhole - to_viewpoint - axis_m) <= 1e-8 * reach).all()
    near = t < 0.9 * mirror.t_limit
    bound = 64.0 * EPS * reach[near]
    assert (np.abs(to_pinhole - to_viewpoint - axis_m)[near] <= bound).all()


@PROPERTY
@given(seeds, ks)
def test_projection_when_computed_in_float32_is_within_its_bound(seed: int, k: float) -> None:
    mirror, t = incidence_tangents(seed, k)
    t = t[(t > 1e-30) & (t < 1e15)]
    single = t.astype(np.float32)
    expected = mirror.radius_ratio_from_t(single.astype(np.float64))
    shown = mirror.radius_ratio_from_t(single)
    assert shown.dtype == np.float32
    # Eight operations of half an ulp, of which 1 - kappa t may be amplified by the nearness of 1.
    left = mirror.one_minus_kappa + mirror.kappa * (1.0 - single.astype(np.float64))
    amplified = (mirror.one_minus_kappa + mirror.kappa * np.abs(1.0 - t)) / left
    assert (np.abs(shown / expected - 1.0) <= 4.0 * EPS32 * (1.0 + amplified)).all()


@PROPERTY
@given(seeds, ks)
def test_pixel_when_sent_to_a_direction_and_back_is_the_same(seed: int, k: float) -> None:
    camera, rng = some_camera(seed, k)
    size = np.array((camera.width_px, camera.height_px))
    pixel = rng.uniform(0.0, 1.0, (PLACES, 2)) * size
    direction, valid = direction_from_pixel(camera, pixel)
    assert np.abs(np.linalg.norm(direction, axis=-1) - 1.0).max() <= 4.0 * EPS
    back, seen = pixel_from_direction(camera, direction)
    # On the rim itself either side may be taken: in pictures of a few pixels by a few.
    assert (valid & ~seen).sum() <= 0.01 * PLACES
    both = seen & valid
    # A direction is known to an ulp of 1; how many pixels that is, is the magnification.
    slope = float(camera.projection.radius_ratio_slope(np.array(camera.rim_t)))
    bound = EPS * (64.0 * size.max() + 16.0 * camera.horizon_radius_px * slope)
    assert np.abs(back - pixel)[both].max(initial=0.0) <= bound


@PROPERTY
@given(seeds, ks)
def test_direction_when_mirrored_has_the_mirrored_pixel(seed: int, k: float) -> None:
    camera, rng = some_camera(seed, k)
    direction = rng.normal(size=(PLACES, 3))
    pixel, seen = pixel_from_direction(camera, direction)
    turned, also_seen = pixel_from_direction(camera, direction * (-1.0, -1.0, 1.0))
    assert np.array_equal(seen, also_seen)
    middle = np.array(camera.centre_px)
    # Half a turn around the axis turns the picture by half a turn: to the last ulp of a pixel.
    np.testing.assert_allclose(pixel - middle, middle - turned, atol=4.0 * EPS * middle.max() + EPS)


@PROPERTY
@given(seeds)
def test_half_angle_is_continuous_at_the_horizon(seed: int) -> None:
    note(f"seed = {seed}")
    rng = np.random.default_rng(seed)
    level = rng.normal(size=(PLACES, 2))
    tiny = 10.0 ** rng.uniform(-320.0, -12.0, PLACES)
    sides = []
    for z in (tiny, -tiny):
        t, valid = half_angle_tangent(np.column_stack((level, z)))
        assert valid.all()
        sides.append(t)
    slope = tiny / np.hypot(*level.T)
    np.testing.assert_allclose(sides[0], 1.0 - slope, rtol=3.0 * EPS)
    np.testing.assert_allclose(sides[1], 1.0 + slope, rtol=3.0 * EPS)


@PROPERTY
@given(seeds)
def test_half_angles_of_opposite_directions_are_each_other_s_inverse(seed: int) -> None:
    note(f"seed = {seed}")
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-307.0, 307.0, (PLACES, 1))
    direction = scale * rng.normal(size=(PLACES, 3)) / 8.0
    one, _ = half_angle_tangent(direction)
    other, _ = half_angle_tangent(-direction)
    np.testing.assert_allclose(one * other, 1.0, rtol=8.0 * EPS)


@PROPERTY
@given(seeds)
def test_direction_has_one_face_and_returns_from_its_coordinates(seed: int) -> None:
    note(f"seed = {seed}")
    rng = np.random.default_rng(seed)
    # Whole numbers, so that one in five lies on an edge or a corner.
    direction = rng.integers(-4, 5, (PLACES, 3)).astype(np.float64)
    direction = direction[(direction != 0.0).any(axis=-1)]
    face = face_from_direction(direction)
    ahead = np.einsum(
        "ni,nji->nj", direction, MIRROR_FROM_FACE_ROTATIONS[:, :, 0][None].repeat(len(direction), 0)
    )
    assert np.array_equal(face, np.argmax(ahead, axis=-1))
    place = face_coordinates(direction, face)
    assert np.abs(place).max() <= 1.0
    local = np.column_stack((np.ones(len(place)), place))
    back = np.einsum("nij,nj->ni", MIRROR_FROM_FACE_ROTATIONS[face], local)
    longest = np.abs(direction).max(axis=-1, keepdims=True)
    np.testing.assert_allclose(back, direction / longest, atol=2.0 * EPS)


@settings(derandomize=True, max_examples=600, deadline=None)
@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(0, 6))
def test_number_when_printed_is_truncated_and_printing_again_changes_nothing(
    value: float, decimals: int
) -> None:
    printed = format_fixed_point(value, decimals)
    again = number_from_text(printed)
    assert format_fixed_point(again, decimals) == printed
    assert format_fixed_point(-value, decimals) == (
        printed[1:] if printed[0] == "-" else f"-{printed}"
    )
    assert number_from_text(format_exact(value)) == value


@pytest.mark.parametrize("k", [2.0 + 1e-12, 2.5, 11.546, 1e9])
def test_projection_is_continuous_at_the_horizon(k: float) -> None:
    mirror = HyperbolicMirror(k, 0.2)
    t = np.array([math.nextafter(1.0, 0.0), 1.0, math.nextafter(1.0, 2.0)])
    t = t[t < mirror.t_limit]
    ratio = mirror.radius_ratio_from_t(t)
    # A neighbour is an ulp away, and the slope says how far that is in the picture.
    slope = float(mirror.radius_ratio_slope(np.array(1.0)))
    assert np.abs(ratio - 1.0).max() <= (2.0 + 2.0 * slope) * EPS
    assert ratio[1] == pytest.approx(1.0, abs=2.0 * EPS)
