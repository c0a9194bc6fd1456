"""Bad scenes, bad numbers and extreme sizes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.renderer import FaceCamera
from catoptra_server.render.trace.ray_table import face_ray_table, lens_ray_table
from catoptra_server.render.trace.trace_engine import NOTHING
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import (
    Box,
    HemisphereLight,
    Item,
    Material,
    Rectangle,
    World,
)
from helpers.dynamic_objects import place_cube
from helpers.trace_kernels import make_omni_table, open_kernel
from helpers.worlds import CAMERA_STATE, make_test_world

WHITE = Material((1.0, 1.0, 1.0), unlit=True)
EMPTY = World("w", (), background=(1.0, 1.0, 1.0))
FLOOR = World("w", (Item("floor", Rectangle((9.0, 9.0)), Pose.identity(), WHITE),))
TABLE = make_omni_table(width_px=40)
BELOW = face_ray_table(FaceCamera(Face.C, 16), 1)


def change_corners(scene: SceneMesh, triangle: int, value: float) -> SceneMesh:
    """The scene with one coordinate of a triangle changed, in the box around it still."""
    corners = scene.corners.copy()
    corners[triangle, 0, 0] = value
    changed = replace(scene, corners=corners)
    for name in ("box_min", "box_max", "centre", "is_large"):
        object.__setattr__(changed, name, getattr(scene, name))
    return changed


# Sizes.


@pytest.mark.parametrize(("width_px", "height_px"), [(1, 1), (3, 2), (5, 1), (1, 9), (17, 6)])
@pytest.mark.parametrize("samples", [1, 3])
def test_image_of_any_size_is_filled_to_its_last_pixel(
    width_px: int, height_px: int, samples: int
) -> None:
    table = lens_ray_table(PerspectiveCamera(width_px, height_px, 1.0), samples)
    with open_kernel(EMPTY) as engine:
        rays = engine.prepare(table)
        image = rays.render_srgb(CAMERA_STATE)
        np.testing.assert_allclose(rays.render_linear(CAMERA_STATE), 1.0, rtol=1e-6)
    assert image.shape == (height_px, width_px, 3)
    assert (image == 255).all()


def test_image_of_more_tiles_than_16_bits_count_is_rendered() -> None:
    table = lens_ray_table(PerspectiveCamera(4112, 256, 1.0), 1)
    assert len(table.tiles) == 65792
    with open_kernel(FLOOR, threads=2) as engine:
        rays = engine.prepare(table)
        below = Pose.from_rpy((0.0, 0.0, -0.6), (0.0, -0.5 * np.pi, 0.0))
        assert (rays.render_srgb(CameraState(below)) == 255).all()
        assert rays.last_counts.num_tiles == 65792


def test_view_without_a_ray_is_black() -> None:
    table = replace(
        BELOW, tiles=BELOW.tiles[:0], directions=BELOW.directions[:0], valid=BELOW.valid[:0]
    )
    with open_kernel(FLOOR) as engine:
        rays = engine.prepare(table)
        assert not rays.render_srgb(CAMERA_STATE).any()
        assert rays.find_hits(CAMERA_STATE).range_m.shape == (0, 1, 16)


def test_samples_when_most_numerous_are_rendered() -> None:
    with open_kernel(make_test_world()) as engine:
        rays = engine.prepare(face_ray_table(FaceCamera(Face.N, 6), 16))
        coarse = engine.prepare(face_ray_table(FaceCamera(Face.N, 6), 8))
        difference = rays.render_linear(CAMERA_STATE) - coarse.render_linear(CAMERA_STATE)
    assert np.abs(difference).max() < 0.05


# Scenes.


def test_scene_when_empty_is_background_and_objects() -> None:
    state = CameraState(Pose.identity(), (place_cube(0.0, 0.0, 1.0),), has_shadows=True)
    with open_kernel(EMPTY) as engine:
        rays = engine.prepare(BELOW)
        image = rays.render_srgb(state)
        hits = rays.find_hits(state)
    assert image[0, 0].tolist() == [255, 255, 255]
    assert image[8, 8].tolist() == [255, 0, 0]
    assert set(np.unique(hits.object)) == {NOTHING, 1}


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e38])
def test_triangle_when_a_corner_is_no_number_is_not_met_and_hides_nothing(value: float) -> None:
    crate = Item("crate", Box((0.2, 0.2, 0.2)), Pose.from_rpy((0.0, 0.0, -0.3)), WHITE)
    scene = build_scene(replace(FLOOR, items=(*FLOOR.items, crate)))
    with np.errstate(all="ignore"):
        scene = change_corners(scene, 4, value)
        with open_kernel(FLOOR, scene=scene) as engine:
            rays = engine.prepare(TABLE)
            state = CameraState(CAMERA_STATE.world_from_mirror, has_shadows=False)
            hits = rays.find_hits(state)
            image = rays.render_srgb(state)
    assert 4 not in hits.triangle
    assert {0, 1} <= set(hits.triangle.reshape(-1).tolist())
    assert set(np.unique(image)) == {0, 255}


def test_triangles_without_area_are_not_met() -> None:
    scene = build_scene(FLOOR)
    line, point = scene.corners.copy(), scene.corners.copy()
    line[:, 2] = 0.5 * (line[:, 0] + line[:, 1])
    point[:] = point[:, :1]
    for corners in (line, point):
        flat = replace(scene, corners=corners, normals=np.zeros((2, 3)))
        with open_kernel(FLOOR, scene=flat) as engine:
            for has_shadows in (False, True):
                state = replace(CAMERA_STATE, has_shadows=has_shadows)
                rays = engine.prepare(BELOW)
                assert not rays.render_srgb(state).any()
                assert set(np.unique(rays.find_hits(state).object)) == {NOTHING}


def test_radiance_when_no_number_is_black_in_srgb() -> None:
    scene = build_scene(FLOOR)
    albedo = np.full((2, 3), (np.nan, np.inf, -np.inf))
    light = HemisphereLight((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    for unlit in (True, False):
        bad = replace(scene, albedo=albedo, unlit=np.full(2, unlit))
        with (
            np.errstate(all="ignore"),
            open_kernel(replace(FLOOR, lights=(light,)), scene=bad) as engine,
        ):
            for samples in (1, 2):
                rays = engine.prepare(face_ray_table(FaceCamera(Face.C, 16), samples))
                image = rays.render_srgb(CAMERA_STATE)
                assert np.unique(image.reshape(-1, 3), axis=0).tolist() == [[0, 255, 0]]


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30])
def test_pose_when_no_number_gives_an_image_of_the_right_size(value: float) -> None:
    lost = Pose(np.eye(3), np.array((value, 0.0, 0.0)))
    turned = Pose(np.full((3, 3), value), np.zeros(3))
    cube = replace(place_cube(0.5, 0.0, -0.5), world_from_object=lost)
    states = [CameraState(lost), CameraState(turned), replace(CAMERA_STATE, objects=(cube,))]
    with np.errstate(all="ignore"), open_kernel(make_test_world()) as engine:
        for state in states:
            for has_shadows in (False, True):
                image = engine.prepare(TABLE).render_srgb(replace(state, has_shadows=has_shadows))
                assert image.shape == (40, 40, 3)
