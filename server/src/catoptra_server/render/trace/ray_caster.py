"""Distances along rays in the static scene, for sensors that measure range, without any radiance.

By the native kernel, and by the reference's search in NumPy where the kernel cannot run. Both are
watertight: no ray slips between two triangles that share an edge. The kernel's hierarchy is the
renderer's where there is one, and outlives a renderer that is made anew while sensors measure.
"""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.trace.kernel.kernel_ray_caster import KernelMeshCaster
from catoptra_server.render.trace.kernel.library import KernelUnavailableError
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shapes import hit_normals

log = logging.getLogger(__name__)


_FindHits = Callable[[Floats, Floats], tuple[Floats, npt.NDArray[np.int32]]]


class SceneRayCaster:
    """Distances in a scene; twin: `simulation/sensors/__init__.py:RayCaster`."""

    def __init__(
        self, scene: SceneMesh, find_hits: _FindHits, kernel: KernelMeshCaster | None = None
    ) -> None:
        """Cast rays by a search.

        Args:
            scene: The scene.
            find_hits: `closest_triangles` of its triangles.
            kernel: The native one, if it is that.
        """
        self._normals = scene.normals
        self._find_hits = find_hits
        self.kernel = kernel

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        """(n,) distances, metres, along unit (n, 3) directions from (n, 3) points; else inf."""
        return self._find_hits(origins, directions)[0]

    def closest_hits(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Distances, and the (n, 3) unit normals by winding order; zero without a hit."""
        distances, triangles = self._find_hits(origins, directions)
        return distances, hit_normals(self._normals, triangles)

    def closest_triangles(
        self, origins: Floats, directions: Floats
    ) -> tuple[Floats, npt.NDArray[np.int32]]:
        """(n,) distances and triangles; infinite and -1 without a hit."""
        return self._find_hits(origins, directions)


def commit_ray_caster(scene: SceneMesh) -> SceneRayCaster:
    """Commit a scene for distance queries: to the kernel, or to NumPy where that cannot run."""
    try:
        return commit_to_kernel(scene)
    except KernelUnavailableError as error:
        log.warning("%s; sensors cast their rays in NumPy, many times slower", error)
    return commit_to_reference(scene)


def commit_to_kernel(scene: SceneMesh) -> SceneRayCaster:
    """Commit a scene to the kernel; errors as of `KernelMeshCaster`."""
    kernel = KernelMeshCaster.of_scene(scene)
    return SceneRayCaster(scene, kernel.closest_triangles, kernel)


def commit_to_reference(scene: SceneMesh) -> SceneRayCaster:
    """Sort a scene's triangles for distance queries in float64: a million in 2 s."""
    # Where the kernel runs nothing of the reference is loaded.
    from catoptra_server.render.trace.reference.meshes import make_search

    # Holes are those of the images themselves.
    textures = tuple((image,) for image in scene.textures)
    rows = np.arange(len(scene))
    search = make_search(scene, np.zeros(3), textures, rows, sees_backs=True)
    return SceneRayCaster(scene, lambda origins, ways: search.first_hits(origins, ways)[:2])
