"""Lighting and texture model, number by number: the reference of both renderers."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.shading import (
    facet_irradiance,
    facet_radiance,
    point_irradiance,
    point_lights,
    sample_texture,
    write_facet_radiance,
)
from catoptra_server.world.world_description import (
    Box,
    DirectionalLight,
    HemisphereLight,
    Item,
    Material,
    PointLight,
    World,
)

UP, DOWN, NORTH = (0.0, 0.0, -1.0), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)
SKY = HemisphereLight((0.8, 0.6, 0.4), (0.2, 0.1, 0.0))
LIGHT = PointLight((0.0, 0.0, -2.0), (4.0, 2.0, 1.0))
# Four texels: 0 and 1 above, 2 and 3 below, in all channels.
TEXELS = np.arange(4.0).reshape(2, 2, 1) * np.ones(3)


@pytest.mark.parametrize(
    ("normal", "irradiance"),
    [(UP, (0.8, 0.6, 0.4)), (DOWN, (0.2, 0.1, 0.0)), (NORTH, (0.5, 0.35, 0.2))],
)
def test_hemisphere_light_depends_on_the_upward_normal(
    normal: tuple[float, ...], irradiance: tuple[float, ...]
) -> None:
    np.testing.assert_allclose(facet_irradiance([SKY], np.array([normal])), [irradiance])


@pytest.mark.parametrize(
    ("normal", "fraction"), [(UP, 0.8), (NORTH, 0.0), (DOWN, 0.0), ((-0.6, 0.0, -0.8), 1.0)]
)
def test_directional_light_follows_the_cosine(normal: tuple[float, ...], fraction: float) -> None:
    light = DirectionalLight((0.6, 0.0, 0.8), (1.0, 0.5, 0.25))
    lit = facet_irradiance([light], np.array([normal]))
    np.testing.assert_allclose(lit, [[fraction, 0.5 * fraction, 0.25 * fraction]], atol=1e-15)


def test_several_lights_add_up() -> None:
    normals = np.array([UP, NORTH])
    both = facet_irradiance([SKY, LIGHT, SKY], normals)
    np.testing.assert_allclose(both, 2.0 * facet_irradiance([SKY], normals))


@pytest.mark.parametrize(
    ("point", "normal", "fraction"),
    [
        ((0.0, 0.0, 0.0), UP, 0.25),  # 2 m below: the inverse square
        ((0.0, 0.0, -1.0), UP, 1.0),  # 1 m: the intensity is what 1 m gets
        ((2.0, 0.0, 0.0), UP, 0.125 * np.sqrt(0.5)),  # 45 degrees aside
        ((0.0, 0.0, 0.0), DOWN, 0.0),
        ((0.0, 0.0, 0.0), NORTH, 0.0),
    ],
)
def test_point_light_follows_cosine_and_inverse_square(
    point: tuple[float, ...], normal: tuple[float, ...], fraction: float
) -> None:
    lit = point_irradiance([LIGHT], np.array([point]), np.array([normal]))
    np.testing.assert_allclose(lit, [[4.0 * fraction, 2.0 * fraction, fraction]], atol=1e-15)


def test_point_lights_are_selected() -> None:
    assert point_lights([SKY, LIGHT]) == (LIGHT,)


def test_facet_radiance_is_albedo_times_irradiance_or_albedo_if_unlit() -> None:
    box = Box((1.0, 1.0, 1.0))
    items = (
        Item("lit", box, Pose.identity(), Material((0.5, 0.5, 0.5))),
        Item("unlit", box, Pose.identity(), Material((0.5, 0.4, 0.3), unlit=True)),
    )
    scene = build_scene(World("w", items, lights=(SKY,)))
    radiance = facet_radiance(scene, [SKY])
    top = (scene.item_index == 0) & (scene.normals[:, 2] < -0.9)
    np.testing.assert_allclose(radiance[top], 2 * [(0.4, 0.3, 0.2)])
    np.testing.assert_allclose(radiance[scene.item_index == 1], 12 * [(0.5, 0.4, 0.3)])
    written = np.zeros(radiance.shape, dtype=np.float32)
    write_facet_radiance(scene, [SKY], written)
    np.testing.assert_array_equal(written, radiance.astype(np.float32))


@pytest.mark.parametrize(
    ("uv", "value"),
    [
        ((0.25, 0.25), 0.0),  # the middle of the first texel
        ((0.75, 0.25), 1.0),
        ((0.25, 0.75), 2.0),
        ((0.5, 0.25), 0.5),  # between two
        ((0.5, 0.5), 1.5),  # among all four
        ((0.0, 0.25), 0.5),  # at the border: it repeats
        ((1.0, 0.25), 0.5),
        ((1.25, -0.75), 0.0),
        ((-0.25, 0.25), 1.0),
        ((1e6 + 0.25, 0.25), 0.0),
    ],
)
def test_texture_is_bilinear_and_repeats(uv: tuple[float, float], value: float) -> None:
    np.testing.assert_allclose(sample_texture(TEXELS, np.array([uv])), [3 * [value]], atol=1e-9)


def test_texture_of_one_texel_is_uniform() -> None:
    uv = np.random.default_rng(1).uniform(-5.0, 5.0, (50, 2))
    np.testing.assert_allclose(sample_texture(np.full((1, 1, 3), 0.7), uv), 0.7)
