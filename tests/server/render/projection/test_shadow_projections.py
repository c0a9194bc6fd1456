"""Positions of casters in shadow maps, in float64."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.projection.shadow_projections import (
    ShadowCasters,
    ShadowProjection,
    fit_shadow_projections,
)
from catoptra_server.world.shading import ShadowCastingLight
from catoptra_server.world.world_description import DirectionalLight, PointLight
from helpers.dynamic_objects import TWO_ROBOTS

ORIGIN = np.array((100.0, -50.0, 2.0))
LIGHT_AT = np.array((0.3, -0.2, -1.4))
LIGHT = PointLight((100.3, -50.2, 0.6), (1.0, 1.0, 1.0))
RNG = np.random.default_rng(4)
CORNERS = RNG.uniform(-2.0, 2.0, (200, 3, 3))
CASTERS = ShadowCasters.from_triangles(CORNERS, np.zeros((200, 3)), light_positions=(LIGHT_AT,))


def fit(
    light: ShadowCastingLight, casters: ShadowCasters = CASTERS
) -> tuple[ShadowProjection, ...]:
    return fit_shadow_projections((light,), casters, origin=ORIGIN, side_texels=1024)


def project(frame: ShadowProjection, points: Floats, viewpoint: Floats) -> Floats:
    """(n, 4): u, v, depth and w of points in the scene's frame, for a viewpoint."""
    positions = np.concatenate((points - viewpoint, np.ones((len(points), 1))), axis=-1)
    clip = positions @ frame.map_from_offset(viewpoint).T
    return np.concatenate((clip[:, :3] / clip[:, 3:], clip[:, 3:]), axis=-1)


@pytest.mark.parametrize(
    "direction", [(0.0, 0.0, 1.0), (0.6, 0.0, 0.8), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)]
)
def test_directional_light_when_fitted_projects_all_casters_square_and_in_parallel(
    direction: tuple[float, float, float],
) -> None:
    (frame,) = fit(DirectionalLight(direction, (1.0, 1.0, 1.0)))
    points, viewpoint = CORNERS.reshape(-1, 3), np.array((0.3, 0.2, -0.5))
    at = project(frame, points, viewpoint)
    assert at[:, :3].min() > 0.0
    assert at[:, :3].max() < 1.0
    along = project(frame, points + 0.05 * np.asarray(direction), viewpoint)
    np.testing.assert_allclose(along[:, :2], at[:, :2], atol=1e-12)
    assert (along[:, 2] > at[:, 2]).all()
    # Across the light a metre is as long in both directions: half a texel's diagonal says which.
    linear = frame.map_from_offset(viewpoint)[:2, :3]
    np.testing.assert_allclose(linear @ linear.T, np.eye(2) * (linear[0] @ linear[0]), atol=1e-12)
    texel_m = 1.0 / (1024 * np.linalg.norm(linear[0]))
    assert frame.half_texel_diagonal_m == pytest.approx(texel_m / np.sqrt(2.0))


def test_point_light_when_fitted_projects_each_caster_into_the_face_that_the_shader_samples() -> (
    None
):
    six = fit(LIGHT)
    points = CORNERS.reshape(-1, 3)
    from_light = points - LIGHT_AT
    axis = np.abs(from_light).argmax(axis=1)
    forward = np.take_along_axis(from_light, axis[:, None], axis=1)[:, 0]
    face = 2 * axis + (forward < 0.0)
    across = np.stack([from_light[np.arange(len(points)), (axis + k) % 3] for k in (1, 2)], axis=-1)
    for index, frame in enumerate(six):
        own = face == index
        at = project(frame, points[own], np.zeros(3))
        np.testing.assert_allclose(at[:, 3], np.abs(forward[own]), atol=1e-12)
        expected = 0.5 + 0.5 * across[own] / np.abs(forward[own])[:, None]
        np.testing.assert_allclose(at[:, :2], expected, atol=1e-12)
        first, second = frame.depth_from_forward
        np.testing.assert_allclose(at[:, 2], first + second / at[:, 3], atol=1e-9)
        assert at[:, 2].min() > 0.0
        assert at[:, 2].max() < 1.0


def test_objects_when_fitted_lie_within_their_map() -> None:
    casters = ShadowCasters.from_objects(TWO_ROBOTS, origin=ORIGIN, light_positions=(LIGHT_AT,))
    (frame,) = fit(DirectionalLight((0.6, 0.0, 0.8), (1.0, 1.0, 1.0)), casters)
    for dynamic_object in TWO_ROBOTS:
        corners = (
            dynamic_object.world_from_object.transform_points(dynamic_object.mesh.corners).reshape(
                -1, 3
            )
            - ORIGIN
        )
        at = project(frame, corners, np.zeros(3))[:, :3]
        assert ((at > 0.0) & (at < 1.0)).all()
    assert casters.min_distances_m[0] > 90.0
