"""Distances of the kernel's single rays: the bits of embreex's, from any number of threads."""

from __future__ import annotations

import gc
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.trace.kernel.kernel_ray_caster import KernelRayCaster
from catoptra_server.render.trace.kernel.library import KernelDevice, KernelUnavailableError
from catoptra_server.render.trace.ray_caster import EmbreeRayCaster
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from helpers.worlds import make_test_world

NUM_RAYS = 20_000
WAIT_S = 20.0


def commit_or_skip(scene: SceneMesh) -> KernelRayCaster:
    try:
        return KernelRayCaster(scene)
    except KernelUnavailableError as error:
        pytest.skip(str(error))


def make_rays(seed: int) -> tuple[Floats, Floats]:
    """(n, 3) origins among the test world's items, and unit directions."""
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((NUM_RAYS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return rng.uniform((-3.0, -3.0, -1.5), (3.0, 3.0, -0.05), (NUM_RAYS, 3)), directions


def test_distances_and_normals_are_those_of_embreex_to_the_last_bit() -> None:
    scene = build_scene(make_test_world())
    rays = make_rays(1)
    distances, normals = commit_or_skip(scene).closest_hits(*rays)
    expected, expected_normals = EmbreeRayCaster(scene).closest_hits(*rays)
    assert 0.2 < np.isfinite(expected).mean() < 1.0, "some rays meet something, others nothing"
    np.testing.assert_array_equal(distances, expected)
    np.testing.assert_array_equal(normals, expected_normals)
    np.testing.assert_array_equal(commit_or_skip(scene).distances(*rays), expected)


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
        KernelRayCaster(scene)
    assert len(closed) == 2
