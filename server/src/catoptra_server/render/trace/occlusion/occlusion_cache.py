"""Occlusion maps on disk: a restarted server does not cast the rays again.

A file belongs to one content of a scene and one way to bake it. A digest of the rest comes first: a
file that is cut off, changed or of another program only means that the map is baked anew.
"""

from __future__ import annotations

import hashlib
import io
import logging
import os
import time
from pathlib import Path

import numpy as np
from numpy.lib.format import read_array

from catoptra_server import __version__
from catoptra_server.runtime.memory import count_processors, release_freed_memory
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import BLOCK, OcclusionMap, hemisphere_lights
from catoptra_server.world.triangles import row_blocks, triangle_boxes
from catoptra_server.world.world_description import World

log = logging.getLogger(__name__)

# Increased when maps change for the same scene.
_FORMAT_VERSION = 3
_ARRAYS = ("patch_of", "columns_from_world", "rows_from_world", "bounds", "texels")
_DIGEST_BYTES = 32
# More triangles than may have grids of their own: here only surfaces of some size have one, two
# nodes wide at the finest. Of a ground of equal small triangles a few would be shaded, in patches.
MANY_TRIANGLES, MIN_SIDE_M = 12_000, 0.1
# The largest atlas and the arrays of its grids, and what each triangle adds; a larger file was not
# written here.
_MAX_BYTES, _BYTES_PER_TRIANGLE = 32 * 2**20, 4


def wants_occlusion(scene: SceneMesh, world: World) -> bool:
    """Whether a world asks for an occlusion map, and something is occluded."""
    return (
        world.ambient_occlusion
        and len(scene) > 0
        and _has_large_triangles(scene)
        and bool(hemisphere_lights(world.lights))
        and not bool(scene.unlit.all())
        and bool(scene.casts_shadows.any())
    )


def _has_large_triangles(scene: SceneMesh) -> bool:
    """Whether some triangle may have a grid."""
    return len(scene) <= MANY_TRIANGLES or any(
        float(np.subtract(*triangle_boxes(scene.corners[block])).min()) <= -MIN_SIDE_M
        for block in row_blocks(len(scene))
    )


def find_occlusion(scene: SceneMesh, folder: Path | None) -> OcclusionMap | None:
    """Occlusion map of a scene, from a folder's cache or baked now; None: nothing is occluded.

    Args:
        scene: Triangles of a world that wants a map.
        folder: Folder of the cache; None for no cache.
    """
    file = None if folder is None else folder / f"{hash_scene(scene)}.bin"
    cached = None if file is None else _read(file, len(scene))
    if cached is not None:
        return cached if len(cached.bounds) else None
    # Loaded where it is needed: most starts find a map.
    from catoptra_server.render.trace.occlusion.baking import bake_occlusion
    from catoptra_server.render.trace.ray_caster import commit_ray_caster

    start = time.perf_counter()
    caster = commit_ray_caster(scene)
    occlusion = bake_occlusion(scene, caster, threads=count_processors())
    del caster
    # Some 20 MiB in a world of a hundred meshes.
    release_freed_memory()
    log.info("ambient occlusion baked in %.2f s", time.perf_counter() - start)
    if file is not None:
        _write(file, _make_open_map(len(scene)) if occlusion is None else occlusion)
    return occlusion


def _make_open_map(num_triangles: int) -> OcclusionMap:
    """A map without grids, which is stored where nothing is occluded."""
    nowhere, rows = np.full(num_triangles, -1, dtype=np.int32), np.zeros((0, 4))
    bounds, texels = np.zeros((0, 4), dtype=np.int32), np.zeros((0, 0), dtype=np.uint8)
    return OcclusionMap(nowhere, rows, rows, bounds, texels)


def hash_scene(scene: SceneMesh) -> str:
    """Digest of all that an occlusion map depends on."""
    # With the release: another one may bake the same scene otherwise.
    digest = hashlib.sha256(f"{_FORMAT_VERSION} {__version__}".encode())
    arrays = (scene.corners, scene.casts_shadows, scene.unlit, scene.albedo, scene.texture_index)
    for array in (*arrays, scene.uv if scene.textures else None, scene.corner_albedo):
        if array is not None:
            digest.update(repr(array.shape).encode())
            digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _read(file: Path, num_triangles: int) -> OcclusionMap | None:
    """Map of a file; None for an absent or unusable one."""
    try:
        with file.open("rb") as opened:
            content = opened.read(_MAX_BYTES + _BYTES_PER_TRIANGLE * num_triangles + 1)
        body = content[_DIGEST_BYTES:]
        if hashlib.sha256(body).digest() != content[:_DIGEST_BYTES]:
            return None
        # One after the other: an archive of NumPy's takes a module of 2 ms.
        arrays = io.BytesIO(body)
        occlusion = OcclusionMap(*(read_array(arrays, allow_pickle=False) for _ in _ARRAYS))
    # Whatever is wrong with the form: NumPy raises any of these.
    except (OSError, ValueError, TypeError):
        return None
    return occlusion if _is_sound(occlusion, num_triangles) else None


def _is_sound(occlusion: OcclusionMap, num_triangles: int) -> bool:
    """Whether no index of a map leads out of its arrays: the kernel checks no index again."""
    count, (height, width) = len(occlusion.bounds), occlusion.texels.shape
    first, last = occlusion.bounds[:, :2], occlusion.bounds[:, 2:]
    types = [getattr(occlusion, name).dtype for name in _ARRAYS]
    return (
        types == [np.int32, np.float64, np.float64, np.int32, np.uint8]
        and occlusion.patch_of.shape == (num_triangles,)
        and occlusion.columns_from_world.shape == occlusion.rows_from_world.shape == (count, 4)
        and bool(((occlusion.patch_of >= -1) & (occlusion.patch_of < count)).all())
        and height % BLOCK == width % BLOCK == 0
        and bool(((first >= 0) & (first < last) & (last < (width, height))).all())
    )


def _write(file: Path, occlusion: OcclusionMap) -> None:
    """Store a map, atomically."""
    body = io.BytesIO()
    for name in _ARRAYS:
        np.save(body, getattr(occlusion, name))
    content = hashlib.sha256(body.getvalue()).digest() + body.getvalue()
    # A file of the process's own, then renamed: another server never reads half a file.
    unfinished = file.with_suffix(f".{os.getpid()}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        unfinished.write_bytes(content)
        unfinished.replace(file)
    except OSError as error:
        log.warning("ambient occlusion cannot be stored in %s: %s", file.parent, error)
