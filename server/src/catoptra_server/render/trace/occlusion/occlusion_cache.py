"""Occlusion maps on disk: a restarted server does not cast the rays again.

A file belongs to one content of a scene and one way to bake it (`runtime/array_cache.py`).
"""

from __future__ import annotations

import hashlib
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server import __version__
from catoptra_server.runtime.array_cache import ArrayCache, find_cache_folder
from catoptra_server.runtime.memory import count_processors, release_freed_memory
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shading import (
    BLOCK,
    OPEN_LIGHT,
    OcclusionMap,
    find_grid_nodes,
    hemisphere_lights,
    shadow_casting_lights,
)
from catoptra_server.world.triangles import row_blocks, triangle_boxes
from catoptra_server.world.world_description import (
    HemisphereLight,
    LightProbes,
    World,
    srgb_from_linear,
)

log = logging.getLogger(__name__)

# Increased when maps change for the same scene.
_FORMAT_VERSION = 3
# The same of baked light.
_LIGHT_VERSION = 5
_LIGHT_ARRAYS = ("brightest", "mean_sky", "error")
_PROBE_ARRAYS = ("first", "step", "faces")
_ARRAYS = ("patch_of", "columns_from_world", "rows_from_world", "bounds", "texels")
# Irradiance below which nothing is lit.
LEAST_LIGHT = 1e-6
# More triangles than may have grids of their own: here only surfaces of some size have one, two
# nodes wide at the finest. Of a ground of equal small triangles a few would be shaded, in patches.
MANY_TRIANGLES, MIN_SIDE_M = 12_000, 0.1


def light_scene(scene: SceneMesh, world: World) -> LitWorld:
    """A scene with its map of baked light or ambient occlusion, and the world's lights beside it.

    Where neither is wanted, both as they are.
    """
    lit = begin_light(scene, world)
    return lit if lit.refine is None else lit.refine(lambda: False)


def begin_light(scene: SceneMesh, world: World) -> LitWorld:
    """The same by a few rays, to be refined, where light is baked and not in the cache."""
    if world.light_bake and not scene.unlit.all():
        return _begin_bake(scene, world)
    if wants_occlusion(scene, world):
        occlusion = find_occlusion(scene, find_cache_folder("occlusion"))
        scene = replace(scene, occlusion=occlusion)
    return LitWorld(scene, world)


def _begin_bake(scene: SceneMesh, world: World) -> LitWorld:
    # Loaded where it is needed: most worlds have none.
    from catoptra_server.render.trace.kernel.library import KernelUnavailableError
    from catoptra_server.render.trace.occlusion import light_bake

    cache, key = ArrayCache(find_cache_folder("light")), hash_light(scene, world)

    def apply(parts: Mapping[str, NodeLight], *, is_final: bool = True) -> LitWorld:
        def mix(factors: Mapping[str, float]) -> tuple[SceneMesh, World]:
            return add_lights(parts, factors).apply(scene, world)

        light = add_lights(parts, {})
        if light.is_dark:
            # More rays may find a small window.
            if is_final:
                log.warning(
                    "LightBake=on, but nothing shines: no lamp, window, sky or luminous surface; "
                    "surfaces are shown at their own colours"
                )
            white = HemisphereLight((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
            return LitWorld(scene, replace(world, lights=(white,), area_lights=()))
        return LitWorld(*light.apply(scene, world), mix=mix)

    names = ["", *world.light_groups]
    stored = _read_light(cache, key, len(scene), names)
    if stored is not None:
        return apply(stored)
    start = time.perf_counter()
    passes, rays = light_bake.FIRST_PASSES, light_bake.RAYS_PER_PASS
    try:
        first = light_bake.bake_light(
            scene, world, passes, threads=count_processors(), detail=light_bake.FIRST_DETAIL
        )
    except KernelUnavailableError as error:
        log.warning("%s; light is not baked", error)
        return LitWorld(scene, world)
    stage = f"light by {passes * rays} rays a node, up to {light_bake.MAX_PASSES * rays}"
    log.info("%s baked in %.2f s", stage, time.perf_counter() - start)

    def refine(is_stopped: Callable[[], bool]) -> LitWorld:
        # One thread, of the caller's priority: frames have the other processors.
        bake = light_bake.LightBake(scene, world, threads=1)
        parts, needed = {"": first}, light_bake.count_passes(first, passes)
        try:
            while bake.num_passes < needed and not is_stopped():
                bake.cast()
                if bake.num_passes == needed:
                    parts = bake.finish()
                    needed = light_bake.count_passes(add_lights(parts, {}), needed)
        finally:
            bake.close()
        release_freed_memory()
        if not is_stopped():
            seconds = time.perf_counter() - start
            num_rays = bake.num_passes * rays
            log.info("light baked in %.2f s by %d rays a node", seconds, num_rays)
            _store_light(cache, key, parts)
        return apply(parts)

    return replace(apply({"": first}, is_final=False), stage=stage, refine=refine)


@dataclass(frozen=True, slots=True, eq=False)
class NodeLight:
    """Light of a scene's surfaces."""

    occlusion: OcclusionMap
    """Irradiance at nodes, as factors of that of the brightest in each colour."""
    brightest: Floats
    """(3,) irradiance of the factor 1."""
    mean_sky: Floats
    """(2, 3) mean irradiance of level facets, those that face up first."""
    error: npt.NDArray[np.float16]
    """(h, w, 3) bounds of the nodes' errors, of 99 of 100."""
    probes: LightProbes
    """Light of what moves."""

    @property
    def stated_error(self) -> float:
        """Grey levels of a white surface that the errors of 99 of 100 nodes stay below."""
        nodes = self._nodes
        light = self.light.reshape(-1, 3)[nodes]
        error = self.error.reshape(-1, 3)[nodes].astype(np.float64)
        levels = 255.0 * (srgb_from_linear(light + error) - srgb_from_linear(light)).reshape(-1)
        # NumPy's percentile loads a module of 50 ms.
        at = 99 * len(levels) // 100
        return float(np.partition(levels, at)[at]) if len(levels) else 0.0

    @property
    def is_dark(self) -> bool:
        """Whether nothing is lit."""
        return bool(self.brightest.max() <= LEAST_LIGHT)

    def apply(self, scene: SceneMesh, world: World) -> tuple[SceneMesh, World]:
        """The scene and its world, lit by this light instead of hemisphere lights."""
        brightest, up, down = (
            (float(r), float(g), float(b)) for r, g, b in (self.brightest, *self.mean_sky)
        )
        lights = (HemisphereLight(brightest, brightest), *shadow_casting_lights(world.lights))
        ranges = find_ranges(self.light, self.error.astype(np.float64), self.occlusion.bounds)
        occlusion = replace(
            self.occlusion, ranges=ranges / self.brightest, stated_error=self.stated_error
        )
        return (
            replace(scene, occlusion=occlusion),
            replace(
                world,
                lights=lights,
                area_lights=(),
                object_sky=HemisphereLight(up, down),
                probes=self.probes,
            ),
        )

    @property
    def _nodes(self) -> npt.NDArray[np.intp]:
        """(k,) places of nodes in the atlas."""
        return find_grid_nodes(self.occlusion.bounds, self.error.shape[1])[0]

    @property
    def light(self) -> Floats:
        """(h, w, 3) irradiance."""
        light: Floats = self.brightest * np.moveaxis(self.occlusion.planes / OPEN_LIGHT, 0, -1)
        return light


def add_lights(parts: Mapping[str, NodeLight], factors: Mapping[str, float]) -> NodeLight:
    """Sum of the lights of groups, brighter by a factor each; 1 where none is named."""
    if len(parts) == 1:
        return parts[""]
    first, scales = parts[""], [factors.get(name, 1.0) for name in parts]
    pairs = [*zip(scales, parts.values(), strict=True)]
    light = sum((scale * part.light for scale, part in pairs), np.zeros(3))
    error = sum((scale * part.error.astype(np.float32) for scale, part in pairs), np.float32(0.0))
    at_nodes = light.reshape(-1, 3)[first._nodes]
    brightest = np.maximum(at_nodes.max(axis=0, initial=0.0), LEAST_LIGHT)
    texels = np.rint(np.minimum(light / brightest, 1.0) * OPEN_LIGHT).astype(np.uint16)
    return NodeLight(
        replace(first.occlusion, texels=np.ascontiguousarray(np.moveaxis(texels, -1, 0))),
        brightest,
        sum((scale * part.mean_sky for scale, part in pairs), np.zeros(3)),
        np.asarray(1.001 * error + 0.5 * brightest / OPEN_LIGHT).astype(np.float16),
        replace(
            first.probes,
            faces=np.asarray(sum((scale * part.probes.faces for scale, part in pairs), 0.0)),
        ),
    )


def find_ranges(light: Floats, error: Floats, bounds: npt.NDArray[np.int32]) -> Floats:
    """(3, m, 3) least, mean and largest light on m grids.

    Args:
        light: (h, w, 3) light of nodes.
        error: (h, w, 3) errors, which widen the extremes.
        bounds: (m, 4) as of `OcclusionMap`.
    """
    nodes, number, first = find_grid_nodes(bounds, light.shape[1])
    light, error = light.reshape(-1, 3)[nodes], error.reshape(-1, 3)[nodes]
    least = np.maximum(np.minimum.reduceat(light - error, first), 0.0)
    mean = np.add.reduceat(light, first) / np.bincount(number)[:, None]
    return np.stack((least, mean, np.maximum.reduceat(light + error, first)))


@dataclass(frozen=True, slots=True, eq=False)
class LitWorld:
    """A scene and a world whose light is computed, at first from few rays."""

    scene: SceneMesh
    world: World
    stage: str = ""
    """How much of it is computed; empty for all."""
    refine: Callable[[Callable[[], bool]], LitWorld] | None = None
    """Compute the rest on the calling thread, unless a function says to stop; None: nothing is
    left to do."""
    mix: Callable[[Mapping[str, float]], tuple[SceneMesh, World]] | None = None
    """Make both with the baked light of groups brighter by factors; None without a bake."""


def _read_light(
    cache: ArrayCache, key: str, num_triangles: int, names: Sequence[str]
) -> dict[str, NodeLight] | None:
    """Baked light of groups by their names."""
    size = len(_ARRAYS) + len(_LIGHT_ARRAYS) + len(_PROBE_ARRAYS)
    arrays = cache.read(key, size * len(names))
    if arrays is None:
        return None
    parts = {}
    for number, name in enumerate(names):
        own = arrays[size * number : size * (number + 1)]
        brightest, mean_sky, error = own[len(_ARRAYS) : -len(_PROBE_ARRAYS)]
        probes = LightProbes(*own[-len(_PROBE_ARRAYS) :])
        occlusion = _make_map(own, num_triangles)
        if occlusion is None:
            return None
        parts[name] = NodeLight(occlusion, brightest, mean_sky, error, probes)
    return parts


def _store_light(cache: ArrayCache, key: str, parts: Mapping[str, NodeLight]) -> None:
    """Store baked light of groups."""
    arrays = []
    for light in parts.values():
        arrays += [getattr(light.occlusion, name) for name in _ARRAYS]
        arrays += [getattr(light, name) for name in _LIGHT_ARRAYS]
        arrays += [getattr(light.probes, name) for name in _PROBE_ARRAYS]
    cache.write(key, arrays)


def hash_light(scene: SceneMesh, world: World) -> str:
    """Digest of all that baked light depends on."""
    lights = (world.lights, world.area_lights, world.background)
    digest = hashlib.sha256(f"{_LIGHT_VERSION} {hash_scene(scene)} {lights!r}".encode())
    sky = None if world.sky is None else world.sky.texels
    arrays = (sky, scene.emission, scene.two_sided, scene.coverage, *scene.textures)
    for array in arrays:
        digest.update(b"-" if array is None else np.ascontiguousarray(array).data)
    return digest.hexdigest()


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
    cache = ArrayCache(folder)
    key = "" if folder is None else hash_scene(scene)
    arrays = cache.read(key, len(_ARRAYS))
    cached = None if arrays is None else _make_map(arrays, len(scene))
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
    stored = _make_open_map(len(scene)) if occlusion is None else occlusion
    cache.write(key, [getattr(stored, name) for name in _ARRAYS])
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
    for array in (*arrays, scene.corner_uv if scene.textures else None, scene.corner_albedo):
        if array is not None:
            digest.update(repr(array.shape).encode())
            digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _make_map(arrays: Sequence[Any], num_triangles: int) -> OcclusionMap | None:
    """Map of arrays; None where an index leads out of them: the kernel checks none again."""
    patch_of, columns, rows, bounds, texels = arrays = arrays[: len(_ARRAYS)]
    count, (height, width) = len(bounds), texels.shape[-2:]
    texel = np.uint16 if texels.ndim == 3 else np.uint8
    first, last = bounds[:, :2], bounds[:, 2:]
    is_sound = (
        [one.dtype for one in arrays] == [np.int32, np.float64, np.float64, np.int32, texel]
        and texels.shape[:-2] in ((), (3,))
        and patch_of.shape == (num_triangles,)
        and columns.shape == rows.shape == (count, 4)
        and bool(((patch_of >= -1) & (patch_of < count)).all())
        and height % BLOCK == width % BLOCK == 0
        and bool(((first >= 0) & (first < last) & (last < (width, height))).all())
    )
    return OcclusionMap(*arrays) if is_sound else None
