"""Distances against exact geometry, by the reference and by the kernel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from catoptra_server.render.trace import ray_caster
from catoptra_server.render.trace.kernel.library import KernelUnavailableError
from catoptra_server.render.trace.ray_caster import (
    SceneRayCaster,
    commit_ray_caster,
    commit_to_kernel,
    commit_to_reference,
)
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.world_description import World
from helpers.room_ray_caster import RoomRayCaster, make_room_world

HALF_M = (40.0, 3.0, 2.0)

Commit = Callable[[SceneMesh], SceneRayCaster]


def commit_or_skip(scene: SceneMesh) -> SceneRayCaster:
    try:
        return commit_to_kernel(scene)
    except KernelUnavailableError as error:
        pytest.skip(str(error))


@pytest.fixture(params=[commit_to_reference, commit_or_skip], ids=["reference", "kernel"])
def commit(request: pytest.FixtureRequest) -> Commit:
    made: Commit = request.param
    return made


def test_distances_when_in_a_room_are_exact_and_no_ray_slips_out(commit: Commit) -> None:
    caster = commit(build_scene(make_room_world(HALF_M)))
    generator = np.random.default_rng(1)
    directions = generator.standard_normal((20_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = generator.uniform(-0.95, 0.95, (20_000, 3)) * HALF_M
    exact = RoomRayCaster(HALF_M).distances(origins, directions)
    # float32 around 80 m: 8 micrometres a step, a few of them; the promise is a millimetre.
    np.testing.assert_allclose(caster.distances(origins, directions), exact, atol=1e-4)


def test_distances_when_rays_miss_are_infinite(commit: Commit) -> None:
    directions = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    outside = np.array([[0.0, 0.0, -9.0], [0.0, 0.0, -9.0]])
    caster = commit(build_scene(make_room_world()))
    assert np.isinf(caster.distances(outside, directions)).all()


def test_rays_pass_holes_and_meet_backs_that_no_camera_sees(commit: Commit) -> None:
    scene = build_scene(make_room_world())
    directions = np.array([[0.0, 0.0, 1.0], [0.0, 0.1, 1.0], [1.0, 0.1, 0.1]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = np.zeros((3, 3))
    plain = commit(scene).distances(origins, directions)
    assert np.isfinite(plain).all()
    backs = replace(scene, normals=-scene.normals, single_sided=np.ones(len(scene), dtype=bool))
    np.testing.assert_array_equal(commit(backs).distances(origins, directions), plain)
    # Without the floor's triangles, whose opacity is below that of a surface.
    is_floor = (np.abs(scene.normals[:, 2]) > 0.9)[:, None]
    holed = replace(backs, coverage=np.where(is_floor, [0.9] * 3, [1.1] * 3))
    found = commit(holed).distances(origins, directions)
    assert np.isinf(found[:2]).all()
    assert found[2] == plain[2]


def test_distances_when_the_scene_is_empty_are_infinite(commit: Commit) -> None:
    caster = commit(build_scene(World("empty", ())))
    assert np.isinf(caster.distances(np.zeros((2, 3)), np.eye(3)[:2])).all()


def test_hits_when_in_a_room_have_the_distances_and_normals_of_its_walls(commit: Commit) -> None:
    caster = commit(build_scene(make_room_world(HALF_M)))
    generator = np.random.default_rng(2)
    directions = generator.standard_normal((2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = generator.uniform(-0.9, 0.9, (2000, 3)) * HALF_M
    distances, normals = caster.closest_hits(origins, directions)
    exact, inward = RoomRayCaster(HALF_M).closest_hits(origins, directions)
    np.testing.assert_allclose(distances, exact, atol=1e-4)
    # In a corner a float32 may take the other wall: none of 2000 did by more than the tolerance.
    assert (np.abs(np.sum(normals * inward, axis=1)) > 0.999).mean() > 0.998


def test_hits_when_rays_miss_are_infinite_and_without_normal(commit: Commit) -> None:
    outside, up = np.array([[0.0, 0.0, -9.0]]), np.array([[0.0, 0.0, -1.0]])
    for world in (make_room_world(), World("empty", ())):
        distances, normals = commit(build_scene(world)).closest_hits(outside, up)
        assert np.isinf(distances).all()
        assert not normals.any()


def test_ray_caster_is_the_kernel_s_or_the_reference_where_that_cannot_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(scene: SceneMesh) -> SceneRayCaster:
        raise KernelUnavailableError("a test")

    scene = build_scene(make_room_world())
    origins, ways = np.full((1, 3), 0.1), np.array([[0.6, 0.0, 0.8]])
    by_kernel, by_reference = (
        make(scene).distances(origins, ways) for make in (commit_or_skip, commit_to_reference)
    )
    assert by_kernel != by_reference  # float32 of the one
    assert commit_ray_caster(scene).distances(origins, ways) == by_kernel
    monkeypatch.setattr(ray_caster, "commit_to_kernel", fail)
    assert commit_ray_caster(scene).distances(origins, ways) == by_reference


def test_closest_triangles_are_those_of_the_hits(commit: Commit) -> None:
    scene = build_scene(make_room_world())
    caster = commit(scene)
    origins, directions = np.zeros((4, 3)), np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]])
    distances, triangles = caster.closest_triangles(origins, directions.astype(float))
    np.testing.assert_allclose(distances, [4.0, 3.0, 2.0, 3.0], atol=1e-5)
    names = [scene.item_names[scene.item_index[triangle]] for triangle in triangles]
    assert names == ["wall 0 1", "wall 1 1", "wall 2 1", "wall 1 -1"]


def test_closest_triangles_when_nothing_is_hit_are_none(commit: Commit) -> None:
    for scene in (build_scene(World("empty", ())), build_scene(make_room_world())):
        outside = np.array([[0.0, 0.0, -9.0]])
        distances, triangles = commit(scene).closest_triangles(outside, -np.eye(3)[2:])
        assert (distances.tolist(), triangles.tolist()) == ([np.inf], [-1])
