"""Distances along rays in the static scene by the native kernel, for sensors that measure range.

The rays of a scan are traced as those of a picture are, in blocks of 16.
"""

from __future__ import annotations

import weakref

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.trace.kernel.library import KernelDevice, choose_instruction_set
from catoptra_server.render.trace.kernel.scene_arrays import (
    OwningStruct,
    corner_arrays,
    hole_arrays,
    texture_array,
)
from catoptra_server.runtime.memory import count_processors
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.shapes import hit_normals


class KernelMeshCaster:
    """Triangles committed for single rays."""

    def __init__(
        self,
        corners: Floats,
        centre: Floats,
        *,
        threads: int = 0,
        arrays: OwningStruct | None = None,
    ) -> None:
        """Commit the triangles.

        Args:
            corners: (n, 3, 3) metres.
            centre: (3,) origin of the kernel's float32 coordinates, near the triangles.
            threads: Threads; 0 for one per processor that this process may use.
            arrays: The triangles as the kernel's structure, with holes; None without any.

        Raises:
            KernelUnavailableError: The kernel's library is missing.
        """
        self._centre = centre
        self._device = KernelDevice(choose_instruction_set(), threads or count_processors())
        try:
            self._arrays = arrays or corner_arrays(corners, centre)
            self._mesh = self._device.commit_mesh(self._arrays.struct)
        except BaseException:
            self._device.close()
            raise
        # Nobody closes a caster: the process ends, or the last reference.
        weakref.finalize(self, _close, self._device, self._mesh, self._arrays)

    def closest_triangles(
        self, origins: Floats, directions: Floats
    ) -> tuple[Floats, npt.NDArray[np.int32]]:
        """(n,) distances and triangles; infinite and -1 without a hit."""
        starts = np.ascontiguousarray(origins - self._centre)
        rays = np.ascontiguousarray(directions, dtype=np.float32)
        ranges = np.zeros(len(rays), dtype=np.float32)
        triangles = np.zeros(len(rays), dtype=np.int32)
        self._device.cast(self._mesh, starts, rays, ranges, triangles)
        return ranges.astype(np.float64), triangles


class KernelRayCaster:
    """The triangles of a scene, committed for distance queries.

    Committed apart from the renderer, which is made anew after a fault while sensors measure.
    """

    def __init__(self, scene: SceneMesh) -> None:
        """Commit the triangles; arguments and errors as of `KernelMeshCaster`."""
        self._normals = scene.normals
        arrays = None
        if scene.coverage is not None:
            self._textures = texture_array(scene)
            arrays = hole_arrays(scene, scene.centre, self._textures.struct)
        self._mesh = KernelMeshCaster(scene.corners, scene.centre, arrays=arrays)

    def distances(self, origins: Floats, directions: Floats) -> Floats:
        """(n,) distances, metres, along unit (n, 3) directions from (n, 3) points; else inf."""
        return self.closest_triangles(origins, directions)[0]

    def closest_hits(self, origins: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Distances, and the (n, 3) unit normals by winding order; zero without a hit."""
        distances, triangles = self.closest_triangles(origins, directions)
        return distances, hit_normals(self._normals, triangles)

    def closest_triangles(
        self, origins: Floats, directions: Floats
    ) -> tuple[Floats, npt.NDArray[np.int32]]:
        """(n,) distances and triangles; infinite and -1 without a hit."""
        return self._mesh.closest_triangles(origins, directions)


def _close(device: KernelDevice, mesh: int, arrays: object) -> None:
    """Free a mesh and the device; the arrays live until here."""
    device.release_mesh(mesh)
    device.close()
