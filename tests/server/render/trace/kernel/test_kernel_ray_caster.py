"""Distances of the kernel's rays, from any number of threads; what a search must never do."""

from __future__ import annotations

import gc
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.trace.kernel.kernel_ray_caster import KernelMeshCaster
from catoptra_server.render.trace.kernel.library import KernelDevice, KernelUnavailableError
from catoptra_server.render.trace.ray_caster import SceneRayCaster, commit_to_kernel
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from helpers.worlds import make_test_world

NUM_RAYS = 20_000
WAIT_S = 20.0


def commit_or_skip(scene: SceneMesh) -> SceneRayCaster:
    try:
        return commit_to_kernel(scene)
    except KernelUnavailableError as error:
        pytest.skip(str(error))


def make_rays(seed: int) -> tuple[Floats, Floats]:
    """(n, 3) origins among the test world's items, and unit directions."""
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((NUM_RAYS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return rng.uniform((-3.0, -3.0, -1.5), (3.0, 3.0, -0.05), (NUM_RAYS, 3)), directions


def cast_by_all(corners: Floats, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """(n,) nearest distances by testing all triangles in float64, and (n,) how far inside of its
    triangle the ray passes, relative to the triangle: near 0 at an edge.
    """
    a, b, c = corners.swapaxes(0, 1)
    ab, ac = b - a, c - a
    p = np.cross(directions[:, None], ac)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / (ab * p).sum(-1)
        t = origins[:, None] - a
        u = (t * p).sum(-1) * inverse
        q = np.cross(t, ab)
        v = (directions[:, None] * q).sum(-1) * inverse
        distance = (ac * q).sum(-1) * inverse
    inside = np.minimum(np.minimum(u, v), 1.0 - u - v)
    distance = np.where((inside >= 0.0) & (distance > 0.0), distance, np.inf)
    nearest = distance.argmin(axis=1)[:, None]
    margin = np.abs(np.where(np.isnan(inside), np.inf, inside)).min(axis=1)
    return np.take_along_axis(distance, nearest, 1)[:, 0], margin


def test_distances_are_those_of_all_triangles_in_float64() -> None:
    scene = build_scene(make_test_world())
    origins, directions = make_rays(1)
    distances, normals = commit_or_skip(scene).closest_hits(origins, directions)
    expected, margin = cast_by_all(scene.corners, origins, directions)
    assert 0.2 < np.isfinite(expected).mean() < 1.0, "some rays meet something, others nothing"
    clear = margin > 1e-4
    # Along a plane the rounding of a coordinate is a long way.
    clear &= ~(np.abs((normals * directions).sum(axis=1)) < 0.02) | np.isinf(distances)
    assert clear.mean() > 0.9
    np.testing.assert_allclose(distances[clear], expected[clear], rtol=2e-6, atol=2e-6)
    lengths = np.linalg.norm(normals, axis=1)
    np.testing.assert_allclose(lengths, np.isfinite(distances), atol=1e-6)
    np.testing.assert_array_equal(commit_or_skip(scene).distances(origins, directions), distances)


def make_shell(seed: int, *, radius_m: float, centre_m: float) -> Floats:
    """(n, 3, 3) corners of a closed, bumpy surface around a centre on the diagonal; their vertices
    are float32 numbers.
    """
    rng = np.random.default_rng(seed)
    rows, columns = 24, 31
    polar, azimuth = np.meshgrid(
        np.linspace(0.0, np.pi, rows + 1), 2 * np.pi * np.arange(columns) / columns, indexing="ij"
    )
    bumps = radius_m * rng.uniform(0.5, 1.5, polar.shape)
    bumps[[0, -1]] = radius_m
    level = np.sin(polar)
    level[[0, -1]] = 0.0
    points = np.stack((level * np.cos(azimuth), level * np.sin(azimuth), np.cos(polar)), axis=-1)
    points = (centre_m + bumps[..., None] * points).astype(np.float32).astype(np.float64)
    right = np.roll(points, -1, axis=1)
    a, b, c, d = points[:-1], right[:-1], right[1:], points[1:]
    return np.concatenate((np.stack((a, b, c), 2), np.stack((a, c, d), 2))).reshape(-1, 3, 3)


@pytest.mark.parametrize("radius_m", [1e-3, 1.0, 1e5])
@pytest.mark.parametrize("distance", [0.0, 3.0, 1e3])
def test_rays_through_edges_and_corners_of_a_closed_surface_never_leave_it(
    radius_m: float, distance: float
) -> None:
    rng = np.random.default_rng(3)
    corners = make_shell(5, radius_m=radius_m, centre_m=distance * radius_m)
    caster = mesh_caster_or_skip(corners)
    first, second = rng.integers(0, 3, (2, NUM_RAYS))
    edges = corners[rng.integers(0, len(corners), NUM_RAYS)]
    each = np.arange(NUM_RAYS)
    weight = np.where(rng.uniform(size=NUM_RAYS) < 0.5, 0.0, rng.uniform(size=NUM_RAYS))[:, None]
    aims = edges[each, first] * (1.0 - weight) + edges[each, second] * weight
    origins = distance * radius_m + 0.2 * radius_m * rng.uniform(-1.0, 1.0, (NUM_RAYS, 3))
    directions = aims - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    distances, triangles = caster.closest_triangles(origins, directions)
    assert (triangles >= 0).all()
    assert (distances < 2.0 * radius_m * (1.0 + 1e-5)).all()


def mesh_caster_or_skip(corners: Floats) -> KernelMeshCaster:
    try:
        return KernelMeshCaster(corners, np.zeros(3))
    except KernelUnavailableError as error:
        pytest.skip(str(error))


def test_of_triangles_in_one_place_the_first_is_met() -> None:
    floor = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    caster = mesh_caster_or_skip(np.repeat(floor[None], 100_000, axis=0))
    origins = np.tile([0.0, -0.2, -1.0], (40, 1))
    directions = np.tile([0.0, 0.0, 1.0], (40, 1))
    distances, triangles = caster.closest_triangles(origins, directions)
    assert (distances == 1.0).all()
    assert (triangles == 0).all()


HOSTILE = {
    "not a number": np.nan,
    "infinite": np.inf,
    "beyond all worlds": 1e30,
}


@pytest.mark.parametrize("name", HOSTILE)
def test_triangles_without_a_place_are_never_met(name: str) -> None:
    floor = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    corners = np.repeat(floor[None], 30, axis=0)
    corners[np.arange(29), np.arange(29) % 3, np.arange(29) % 2] = HOSTILE[name]
    origins, directions = np.array([[0.0, -0.2, -1.0]]), np.array([[0.0, 0.0, 1.0]])
    caster = mesh_caster_or_skip(corners)
    assert caster.closest_triangles(origins, directions)[1].tolist() == [29]
    nothing = mesh_caster_or_skip(corners[:29])
    assert nothing.closest_triangles(origins, directions)[1].tolist() == [-1]


def test_points_and_lines_are_never_met_and_needles_are() -> None:
    rng = np.random.default_rng(2)
    points = np.repeat(rng.uniform(-1.0, 1.0, (200, 1, 3)), 3, axis=1)
    lines = points[:100] + np.array([0.0, 0.3, 1.0])[:, None] * rng.uniform(-1, 1, (100, 1, 3))
    origins, directions = make_rays(4)
    flat = mesh_caster_or_skip(np.concatenate((points, lines)))
    assert np.isinf(flat.closest_triangles(origins, directions)[0]).mean() > 0.999
    needles = np.zeros((1000, 3, 3))
    needles[:, 1, 0], needles[:, 2, 1] = 1e4, 1e-4
    needles[..., 2] = np.arange(1000.0)[:, None]
    found = mesh_caster_or_skip(needles).closest_triangles(
        np.array([[5.0, 2e-5, -1.0]]), np.array([[0.0, 0.0, 1.0]])
    )
    assert found[1].tolist() == [0]


def test_distances_cast_by_several_threads_at_once_are_those_of_one() -> None:
    caster = commit_or_skip(build_scene(make_test_world()))
    batches = [make_rays(seed) for seed in range(4)]
    with ThreadPoolExecutor(4) as pool:
        futures = [pool.submit(caster.distances, *rays) for rays in batches]
        found = [future.result(WAIT_S) for future in futures]
    for rays, distances in zip(batches, found, strict=True):
        np.testing.assert_array_equal(distances, caster.distances(*rays))


def test_no_rays_have_no_distances() -> None:
    caster = commit_or_skip(build_scene(make_test_world()))
    assert caster.distances(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)


def test_device_is_closed_with_the_caster_and_where_no_scene_can_be_committed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    closed: list[KernelDevice] = []
    close = KernelDevice.close

    def count(device: KernelDevice) -> None:
        closed.append(device)
        close(device)

    def fail(device: KernelDevice, arrays: Any) -> int:
        raise KernelUnavailableError("a test")

    scene = build_scene(make_test_world())
    commit_or_skip(scene)
    gc.collect()
    monkeypatch.setattr(KernelDevice, "close", count)
    caster = commit_or_skip(scene)
    del caster
    gc.collect()
    assert len(closed) == 1
    monkeypatch.setattr(KernelDevice, "commit_mesh", fail)
    with pytest.raises(KernelUnavailableError):
        commit_to_kernel(scene)
    assert len(closed) == 2
