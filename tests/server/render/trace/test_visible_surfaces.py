"""Planes from a viewpoint, against points on the planes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.surfaces import BACKGROUND, NO_SURFACE
from catoptra_server.render.trace.visible_surfaces import PlanePoints, SurfacePlanes
from catoptra_server.scene.scene_mesh import SceneMesh, build_scene
from catoptra_server.scene.world_description import Box, Item, Material, World
from helpers.worlds import write_smooth_texture

POSE = Pose.from_rpy((0.2, 0.1, -0.3), (0.1, 0.2, 0.5))


def make_box(folder: Path) -> SceneMesh:
    """A textured box in front of the pose."""
    material = Material((1.0, 1.0, 1.0), write_smooth_texture(folder / "t.png"))
    at = Pose.from_rpy((3.0, 1.0, 0.5), (0.3, 0.1, 0.2))
    return build_scene(World("w", (Item("box", Box((1.0, 2.0, 0.5)), at, material),)))


def test_corners_of_triangles_lie_on_their_planes(tmp_path: Path) -> None:
    scene = make_box(tmp_path)
    planes = SurfacePlanes(scene)
    seen = planes.view_from(POSE)
    surface = planes.surfaces.of_triangle[:-1]
    assert seen.usable[surface].all()
    local = (scene.corners - POSE.translation) @ POSE.rotation
    distance = np.linalg.norm(local, axis=-1)
    positions = PlanePoints(
        directions=(local / distance[..., None]).astype(np.float32),
        turned=POSE.rotation.T.astype(np.float32),
        viewpoint=POSE.translation.astype(np.float32),
        inverse_distance=seen.inverse_distance[surface],
        uv_vectors=seen.uv[surface],
    )
    rays = np.array([0, 7, 8, 20, 35])
    np.testing.assert_allclose(
        positions.positions(rays), scene.corners.reshape(-1, 3)[rays], atol=1e-5
    )
    found = np.stack(positions.uv(rays), axis=-1)
    np.testing.assert_allclose(found, scene.uv.reshape(-1, 2)[rays], atol=1e-5)


def test_plane_through_the_viewpoint_is_not_usable(tmp_path: Path) -> None:
    scene = make_box(tmp_path)
    planes = SurfacePlanes(scene)
    edge = scene.corners[0, 1] - scene.corners[0, 0]
    beside = Pose.from_rpy(tuple(scene.corners[0, 0] - 2.0 * edge + 1e-4 * scene.normals[0]))
    usable = planes.view_from(beside).usable
    surface = planes.surfaces.of_triangle[:-1]
    assert not usable[surface[0]]
    assert 1 <= usable[surface].sum() < len(surface)


def test_background_is_infinitely_far_and_no_surface_is_unusable(tmp_path: Path) -> None:
    seen = SurfacePlanes(make_box(tmp_path)).view_from(POSE)
    assert seen.usable[BACKGROUND]
    assert not seen.usable[NO_SURFACE]
    np.testing.assert_array_equal(seen.inverse_distance[[NO_SURFACE, BACKGROUND]], 0.0)
