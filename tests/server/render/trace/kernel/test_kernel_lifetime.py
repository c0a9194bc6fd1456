"""Engines and rays from end to end: closed ones refuse frames, and nothing of them stays."""

from __future__ import annotations

import gc
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.renderer import FaceCamera
from catoptra_server.render.trace.kernel import kernel_engine as module
from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine
from catoptra_server.render.trace.kernel.kernel_ray_caster import KernelMeshCaster
from catoptra_server.render.trace.kernel.library import KernelDevice, KernelError
from catoptra_server.render.trace.ray_table import face_ray_table
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Item, Material, Rectangle, World
from helpers.dynamic_objects import TWO_ROBOTS
from helpers.memory import resident_mb
from helpers.trace_kernels import make_omni_table, open_kernel
from helpers.worlds import CAMERA_STATE, make_test_world

WHITE = Material((1.0, 1.0, 1.0), unlit=True)
FLOOR = World("w", (Item("floor", Rectangle((9.0, 9.0)), Pose.identity(), WHITE),))
TABLE = make_omni_table(width_px=40)
BELOW = face_ray_table(FaceCamera(Face.C, 16), 1)


def test_view_when_memory_is_short_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def huge(table: object) -> object:
        struct = real(table)  # type: ignore[arg-type]
        struct.width_px, struct.height_px = 4 * 2**25, 4 * 2**14
        struct.tile_columns = 2**25
        return struct

    real = module.ray_table_struct
    monkeypatch.setattr(module, "ray_table_struct", huge)
    with open_kernel(FLOOR) as engine, pytest.raises(KernelError, match="out of memory"):
        engine.prepare(BELOW)


def test_engine_when_closed_refuses_frames_and_closes_again() -> None:
    for has_shadows in (False, True):
        with open_kernel(make_test_world(), threads=2) as engine:
            rays = engine.prepare(TABLE)
            engine.close()
            state = replace(CAMERA_STATE, objects=TWO_ROBOTS, has_shadows=has_shadows)
            for use in (rays.render_srgb, rays.find_hits, rays.trace_bare):
                with pytest.raises(KernelError, match="closed"):
                    use(state)
            with pytest.raises(KernelError, match="closed"):
                engine.prepare(TABLE)
            rays.close()
            rays.close()


def test_rays_when_closed_refuse_frames_and_the_engine_goes_on() -> None:
    with open_kernel(FLOOR) as engine:
        rays, others = engine.prepare(TABLE), engine.prepare(TABLE)
        before = others.render_srgb(CAMERA_STATE)
        rays.close()
        with pytest.raises(KernelError, match="the view is closed"):
            rays.render_srgb(CAMERA_STATE)
        np.testing.assert_array_equal(others.render_srgb(CAMERA_STATE), before)


def test_memory_of_rays_is_that_of_the_table_and_of_the_tiles_beams() -> None:
    with open_kernel(FLOOR) as engine:
        rays = engine.prepare(TABLE)
        beams = rays.memory_bytes - TABLE.memory_bytes
        assert 0 < beams < 400 * (10 * 10)
        rays.close()
        assert rays.memory_bytes == TABLE.memory_bytes


def test_frames_of_several_threads_at_once_have_the_same_bytes() -> None:
    states = [replace(CAMERA_STATE, objects=TWO_ROBOTS[:n], has_shadows=n > 0) for n in (0, 1, 2)]
    with open_kernel(make_test_world(), threads=2) as engine:
        rays = [engine.prepare(TABLE) for _ in states]
        alone = [r.render_srgb(s) for r, s in zip(rays, states, strict=True)]
        with ThreadPoolExecutor(3) as pool:
            for _ in range(10):
                together = list(pool.map(lambda r, s: r.render_srgb(s), rays, states))
                for one, other in zip(alone, together, strict=True):
                    np.testing.assert_array_equal(one, other)


def use_engine() -> None:
    """Create, use and close an engine."""
    with open_kernel(make_test_world(), threads=3) as engine:
        rays = engine.prepare(BELOW)
        rays.render_srgb(replace(CAMERA_STATE, objects=TWO_ROBOTS, has_shadows=True))
        rays.find_hits(CAMERA_STATE)
        rays.close()


def count_resources() -> tuple[int, int]:
    """Threads and open files of this process."""
    return len(list(Path("/proc/self/task").iterdir())), len(list(Path("/proc/self/fd").iterdir()))


def test_engine_when_its_scene_cannot_be_committed_leaves_no_threads(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(device: KernelDevice, arrays: object) -> int:
        raise KernelError("out of memory")

    use_engine()
    before = count_resources()
    monkeypatch.setattr(KernelDevice, "commit_mesh", fail)
    with pytest.raises(KernelError, match="out of memory"):
        KernelEngine(build_scene(FLOOR), FLOOR, threads=4, scene_lights=())
    # The system may still list a thread that was joined before.
    assert all(now <= then for now, then in zip(count_resources(), before, strict=True))


def test_engines_when_many_are_closed_leave_no_threads_files_or_memory() -> None:
    for _ in range(20):
        use_engine()
    gc.collect()
    resources, memory = count_resources(), resident_mb(os.getpid())
    for _ in range(200):
        use_engine()
    gc.collect()
    assert count_resources() == resources
    # An engine of this scene takes 3 MB, a leak of a tenth of it 60 MB.
    assert resident_mb(os.getpid()) < memory + 30.0


@pytest.mark.parametrize("is_single_sided", [False, True])
def test_caster_shares_the_hierarchy_of_an_engine_and_outlives_the_engine(
    monkeypatch: pytest.MonkeyPatch, is_single_sided: bool
) -> None:
    scene = build_scene(FLOOR)
    if is_single_sided:  # backs that no camera sees stop the rays of sensors
        scene = replace(scene, single_sided=np.ones(len(scene), dtype=bool))
    alone = KernelMeshCaster.of_scene(scene)
    engine = KernelEngine(scene, FLOOR, threads=1, scene_lights=())
    commits: list[object] = []
    commit = KernelDevice.commit_mesh
    monkeypatch.setattr(
        KernelDevice, "commit_mesh", lambda *mesh: (commits.append(mesh), commit(*mesh))[1]
    )
    caster = KernelMeshCaster.of_scene(scene)
    assert len(commits) == is_single_sided
    engine.close()
    del engine
    gc.collect()
    origins = np.random.default_rng(39).uniform(-1.0, 1.0, (64, 3)) - (0.0, 0.0, 2.0)
    rays = origins, np.broadcast_to((0.0, 0.0, 1.0), (64, 3))
    pairs = zip(caster.closest_triangles(*rays), alone.closest_triangles(*rays), strict=True)
    for one, other in pairs:
        np.testing.assert_array_equal(one, other)
    assert np.isfinite(caster.closest_triangles(*rays)[0]).all()
