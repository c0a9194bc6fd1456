"""Bounds of irradiance and of objects' radiance: never exceeded, and close."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world import shading
from catoptra_server.world.objects import DynamicObject, build_object_mesh
from catoptra_server.world.scene_radiance import (
    max_facet_irradiance,
    max_object_radiance,
)
from catoptra_server.world.shapes import box
from catoptra_server.world.world_description import (
    Box,
    DirectionalLight,
    HemisphereLight,
    Light,
    Material,
    PointLight,
    World,
)


@pytest.mark.parametrize("seed", range(6))
def test_object_is_never_brighter_than_its_bound_and_half_as_bright_at_least(seed: int) -> None:
    rng = np.random.default_rng(seed)
    lights: tuple[Light, ...] = (
        HemisphereLight((0.4, 0.3, 0.2), (0.1, 0.2, 0.3)),
        DirectionalLight((0.6, 0.0, 0.8), (0.5, 0.6, 0.7)),
        PointLight(tuple(rng.uniform(-2.0, 2.0, 3)), (0.8, 0.9, 1.0)),
    )
    world = World("w", (), lights=lights)
    ball = build_object_mesh([(box(Box((0.1, 0.1, 0.1))), Material((0.9, 0.6, 0.3)))])
    radiances = []
    for _ in range(200):
        pose = Pose.from_rpy(rng.uniform(-1.0, 1.0, 3), rng.uniform(-3.0, 3.0, 3))
        bound = max_object_radiance(DynamicObject(ball, pose), world)
        points = pose.transform_points(ball.corners.reshape(-1, 3))
        normals = np.repeat(ball.normals @ pose.rotation.T, 3, axis=0)
        irradiance = shading.facet_irradiance(lights, normals)
        irradiance += shading.point_irradiance(lights, points, normals)
        brightest = float((np.repeat(ball.albedo, 3, axis=0) * irradiance).max())
        assert brightest <= bound * (1.0 + 1e-12)
        radiances.append(brightest / bound)
    assert max(radiances) > 0.5


@pytest.mark.parametrize("seed", range(4))
def test_facets_near_lamps_are_never_brighter_than_their_bound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1.0, 1.0, (200, 3, 3))
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    light = PointLight(tuple(rng.uniform(-1.0, 1.0, 3)), (0.8, 0.9, 1.0))
    bound = max_facet_irradiance(corners, normals, light)
    weights = rng.dirichlet((0.6, 0.6, 0.6), 400)
    points = np.einsum("pk,nki->npi", weights, corners).reshape(-1, 3)
    sampled = shading.point_irradiance((light,), points, np.repeat(normals, 400, axis=0))
    brightest = sampled.reshape(200, 400, 3).max(axis=1)
    assert (brightest <= bound * (1.0 + 1e-9)).all()
    # Facets that face away are dark, and counted as such.
    assert ((bound == 0.0) == (brightest == 0.0)).all()
