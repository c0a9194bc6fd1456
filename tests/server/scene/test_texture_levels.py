"""Levels of textures, footprints of samples, and how much less a fine texture aliases with them."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.world.shading import sample_texture
from catoptra_server.world.textures import (
    MAX_STRETCH,
    build_levels,
    footprint_texels,
    sample_levels,
    uv_gradients,
    uv_steps,
)
from catoptra_server.world.world_description import linear_from_srgb

RNG = np.random.default_rng(7)


def make_image(height: int, width: int) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    return RNG.integers(0, 256, (height, width, 3)).astype(np.uint8)


@pytest.mark.parametrize("shape", [(8, 8), (5, 7), (1, 9), (13, 1), (1, 1), (6, 3)])
def test_every_level_has_the_mean_light_of_the_image(shape: tuple[int, int]) -> None:
    image = make_image(*shape)
    mean = linear_from_srgb(image / 255.0).mean(axis=(0, 1))
    for level in build_levels(image):
        np.testing.assert_allclose(level.mean(axis=(0, 1)), mean, rtol=1e-5)


def test_sides_are_halved_and_rounded_down_to_one_texel() -> None:
    sizes = [level.shape[:2] for level in build_levels(make_image(21, 6))]
    assert sizes == [(21, 6), (10, 3), (5, 1), (2, 1), (1, 1)]


def test_texel_of_an_odd_side_is_the_mean_of_the_part_that_it_covers() -> None:
    image = make_image(5, 1)
    rows = linear_from_srgb(image / 255.0)
    # 2.5 old rows each: the third is shared.
    upper = (rows[0] + rows[1] + 0.5 * rows[2]) / 2.5
    np.testing.assert_allclose(build_levels(image)[1][0], upper, rtol=1e-5)


def test_coordinates_of_a_triangle_change_by_its_gradients() -> None:
    corners, uv = RNG.normal(size=(6, 3, 3)), RNG.normal(size=(6, 3, 2))
    gradients = uv_gradients(corners, uv)
    moved = np.einsum("nki,nci->nck", gradients, corners[:, 1:] - corners[:, :1])
    np.testing.assert_allclose(moved, uv[:, 1:] - uv[:, :1], atol=1e-9)
    assert not uv_gradients(np.zeros((1, 3, 3)), uv[:1]).any()


def test_steps_are_the_differences_of_coordinates_where_neighbouring_rays_meet_the_plane() -> None:
    normal = np.array([[0.1, -0.2, -0.9]])
    gradients = RNG.normal(size=(1, 2, 3))
    gradients -= np.einsum("nki,ni->nk", gradients, normal)[..., None] * normal / 0.86
    directions = np.array([[0.6, 0.0, 0.8]])
    beside = 1e-6 * RNG.normal(size=(1, 2, 3))

    def meet(direction: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> np.ndarray:  # type: ignore[type-arg]
        return 2.0 * (normal @ directions[0]) / (normal @ direction) * direction

    expected = [
        gradients[0] @ (meet(directions[0] + beside[0, side]) - meet(directions[0]))
        for side in range(2)
    ]
    found = uv_steps(gradients, normal, np.array([2.0]), directions, beside)
    # The second derivative, over steps of a millionth.
    np.testing.assert_allclose(found[0], expected, atol=1e-10)


def test_footprint_of_a_square_is_its_side_whatever_its_direction() -> None:
    turned = 0.01 * np.array([[[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]] for a in (0, 1, 2)])
    np.testing.assert_allclose(footprint_texels(turned, (300, 300)), 3.0)


@pytest.mark.parametrize(("stretch", "expected"), [(2.0, 2.0), (50.0, MAX_STRETCH)])
def test_longer_axis_counts_up_to_a_multiple_of_the_shorter(
    stretch: float, expected: float
) -> None:
    steps = np.array([[[stretch, 0.0], [0.0, 1.0]]]) / 64.0
    np.testing.assert_allclose(footprint_texels(steps, (64, 64)), expected)


def test_small_footprint_reads_the_image_itself() -> None:
    image, uv = make_image(9, 12), RNG.uniform(-2.0, 2.0, (50, 2))
    sharp = sample_texture(linear_from_srgb(image / 255.0), uv)
    for footprint in (0.0, 0.5, 1.0, 1.5):
        found = sample_levels(build_levels(image), uv, np.full(50, footprint))
        np.testing.assert_allclose(found, sharp, rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize(
    ("footprint", "fine", "weight"),
    [(2.0, 1, 0.0), (3.0, 1, 0.0), (3.5, 1, 0.5), (4.0, 2, 0.0), (1e9, 3, 0.0)],
)
def test_larger_footprints_read_their_level(footprint: float, fine: int, weight: float) -> None:
    levels, uv = build_levels(make_image(8, 8)), RNG.uniform(-2.0, 2.0, (50, 2))
    one, other = (
        sample_texture(levels[min(n, 3)].astype(np.float64), uv) for n in (fine, fine + 1)
    )
    found = sample_levels(levels, uv, np.full(50, footprint))
    np.testing.assert_allclose(found, (1.0 - weight) * one + weight * other, atol=1e-6)
