"""Resources of trace for dynamic objects, counted: none without, one scene a mesh with objects."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.embree_objects import EmbreeObjectScenes, intersect_objects
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.packed_light import SrgbScale
from catoptra_server.scene.dynamic_object import DynamicObject
from catoptra_server.scene.robot_shapes import OmniCameraTower, build_ego_body_mesh
from catoptra_server.scene.scene_mesh import build_scene
from helpers.dynamic_objects import P2AT, ROBOT_MESH, TWO_ROBOTS, place_cube
from helpers.worlds import (
    CAMERA_STATE,
    HEMISPHERE_LIGHT,
    make_omni_camera,
    make_plan,
    make_test_world,
)

WITH_ROBOTS = dataclasses.replace(CAMERA_STATE, objects=TWO_ROBOTS)
SCALE = SrgbScale.for_samples(1)
ZERO = np.zeros(3)


def test_without_objects_no_scene_is_committed_and_no_second_ray_traced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(*args: object) -> None:
        raise AssertionError("nothing moves: no occlusion is tested")

    monkeypatch.setattr(EmbreeScene, "occludes", fail)
    world = make_test_world()
    renderer = TraceRenderer(build_scene(world), world, threads=1)
    renderer.prepare(make_omni_camera(), make_plan(make_omni_camera())).render(CAMERA_STATE)
    assert renderer.num_object_meshes == 0
    renderer.close()


def test_robots_of_one_class_are_committed_once_for_all_frames() -> None:
    world = make_test_world()
    renderer = TraceRenderer(build_scene(world), world, threads=1)
    view = renderer.prepare(make_omni_camera(), make_plan(make_omni_camera()))
    for _ in range(3):
        view.render(WITH_ROBOTS)
    assert renderer.num_object_meshes == 1
    renderer.close()


def test_only_rays_within_the_cone_are_tested() -> None:
    (instance,) = EmbreeObjectScenes((HEMISPHERE_LIGHT,)).place_objects(
        (place_cube(3.0, 0.0, 0.0),), ZERO, SCALE
    )
    directions = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0]], dtype=np.float32)
    rays, distance, _ = instance.closest_hit(directions, np.full(3, 1e30, np.float32))
    assert rays.tolist() == [0]
    assert distance == pytest.approx([2.8])


def test_cone_contains_every_ray_that_hits_the_object() -> None:
    rng = np.random.default_rng(6)
    directions = rng.normal(size=(20_000, 3))
    directions = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    (instance,) = EmbreeObjectScenes((HEMISPHERE_LIGHT,)).place_objects(
        TWO_ROBOTS[:1], CAMERA_STATE.world_from_mirror.translation, SCALE
    )
    rays, _, _ = instance.closest_hit(directions, np.full(20_000, 1e30, np.float32))
    everywhere = dataclasses.replace(instance, cone_cosine=-2.0)
    all_rays, _, _ = everywhere.closest_hit(directions, np.full(20_000, 1e30, np.float32))
    assert len(rays) > 100
    assert np.array_equal(rays, all_rays)


@pytest.mark.parametrize("height_m", [0.25, 0.45, 0.8])
def test_cone_when_the_object_is_around_the_pole_below_contains_every_ray_that_hits_it(
    height_m: float,
) -> None:
    rng = np.random.default_rng(7)
    directions = rng.normal(size=(20_000, 3))
    directions = (directions / np.linalg.norm(directions, axis=1, keepdims=True)).astype(np.float32)
    mesh = build_ego_body_mesh(
        P2AT, OmniCameraTower(make_omni_camera(), Pose.from_rpy((0.0, 0.0, -0.4543)))
    )
    dynamic_object = DynamicObject(mesh, Pose.from_rpy((0.7, -0.2, -0.1457), (0.1, 0.0, 1.0)))
    viewpoint = dynamic_object.world_from_object.transform_points(np.array((0.05, 0.02, -height_m)))
    (instance,) = EmbreeObjectScenes((HEMISPHERE_LIGHT,)).place_objects(
        (dynamic_object,), viewpoint, SCALE
    )
    rays, _, _ = instance.closest_hit(directions, np.full(20_000, 1e30, np.float32))
    everywhere = dataclasses.replace(instance, cone_cosine=-2.0)
    all_rays, _, _ = everywhere.closest_hit(directions, np.full(20_000, 1e30, np.float32))
    assert 0.0 < instance.cone_cosine < 1.0
    assert len(rays) > 100
    assert np.array_equal(rays, all_rays)


def test_cone_when_the_object_is_near_is_no_wider_than_its_corners() -> None:
    mesh = build_ego_body_mesh(
        P2AT, OmniCameraTower(make_omni_camera(), Pose.from_rpy((0.0, 0.0, -0.4543)))
    )
    dynamic_object, viewpoint = DynamicObject(mesh, Pose.identity()), np.array((0.0, 0.0, -0.4543))
    (instance,) = EmbreeObjectScenes((HEMISPHERE_LIGHT,)).place_objects(
        (dynamic_object,), viewpoint, SCALE
    )
    # The deck's corners, half its length and the width between the wheels away, 0.31 m below.
    assert np.degrees(np.arccos(instance.cone_cosine)) == pytest.approx(46.7, abs=0.1)


def test_ray_that_ends_before_an_object_hits_nothing() -> None:
    (instance,) = EmbreeObjectScenes((HEMISPHERE_LIGHT,)).place_objects(
        (place_cube(3.0, 0.0, 0.0),), ZERO, SCALE
    )
    ahead = np.array([[1, 0, 0]], dtype=np.float32)
    rays, _, _ = instance.closest_hit(ahead, np.array([2.7], np.float32))
    assert len(rays) == 0


def test_hits_are_the_nearest_of_all_objects() -> None:
    objects = (place_cube(3.0, 0.0, 0.0), place_cube(2.0, 0.0, 0.0), place_cube(4.0, 0.0, 0.0))
    instance = EmbreeObjectScenes((HEMISPHERE_LIGHT,)).place_objects(objects, ZERO, SCALE)
    directions = np.array([[1, 0, 0], [0, 0, 1]], dtype=np.float32)
    rays, distance, light = intersect_objects(instance, directions, SCALE)
    assert rays.tolist() == [0]
    assert distance == pytest.approx([1.8])
    assert SCALE.unpack(light).tolist() == [[255, 0, 0]]


def test_object_at_the_viewpoint_has_no_cone() -> None:
    dynamic_object = dataclasses.replace(TWO_ROBOTS[0], world_from_object=Pose.identity())
    (instance,) = EmbreeObjectScenes((HEMISPHERE_LIGHT,)).place_objects(
        (dynamic_object,), ROBOT_MESH.centre, SCALE
    )
    assert instance.cone_cosine < -1.0
