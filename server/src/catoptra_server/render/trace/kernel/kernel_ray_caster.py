"""First hits of single rays among triangles, by the native kernel: of sensors, and of labels.

The rays of a scan are traced as those of a picture are, in blocks of 16, and in the renderer's
hierarchy where no facet has holes or no back: a second one is a hundred bytes a triangle.
"""

from __future__ import annotations

import weakref

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.trace.kernel.kernel_structs import SinkingStruct
from catoptra_server.render.trace.kernel.library import KernelDevice, choose_instruction_set
from catoptra_server.render.trace.kernel.scene_arrays import (
    OwningStruct,
    corner_arrays,
    hole_arrays,
    hole_textures,
)
from catoptra_server.runtime.memory import count_processors, release_freed_memory
from catoptra_server.world.scene_mesh import SceneMesh


class CommittedScene:
    """Triangles on the kernel, freed with the last reference: after their device, too."""

    def __init__(
        self, device: KernelDevice, owned: OwningStruct, scene: SceneMesh | None = None
    ) -> None:
        """Commit triangles.

        Args:
            device: Device whose threads build the hierarchy.
            owned: The triangles.
            scene: Scene whose casters share them; None for triangles that are nobody else's.
        """
        self._device = device
        self.address = device.commit_mesh(owned.struct)
        weakref.finalize(self, _release, device, self.address, owned)
        if scene is not None and scene.coverage is None and scene.single_sided is None:
            # With the corners, whose identity is theirs alone as long as they are held.
            self._corners = scene.corners
            _SHARED[id(scene.corners)] = self

    def repaint(self, owned: OwningStruct) -> None:
        """Give the same triangles other looks."""
        self._device.repaint_mesh(self.address, owned.struct)
        self._looks = owned


_SHARED: weakref.WeakValueDictionary[int, CommittedScene] = weakref.WeakValueDictionary()
"""Scenes that renderers trace, by the identity of their corners."""


class KernelMeshCaster:
    """Triangles committed for single rays."""

    def __init__(
        self,
        corners: Floats,
        centre: Floats,
        *,
        threads: int = 0,
        arrays: OwningStruct | None = None,
        committed: CommittedScene | None = None,
    ) -> None:
        """Commit the triangles.

        Args:
            corners: (n, 3, 3) metres.
            centre: (3,) origin of the kernel's float32 coordinates, near the triangles.
            threads: Threads; 0 for one per processor that this process may use.
            arrays: The triangles as the kernel's structure, with holes; None without any.
            committed: The triangles where they are committed already, by any device.

        Raises:
            KernelUnavailableError: The kernel's library is missing.
        """
        self._centre = centre
        self._device = KernelDevice(choose_instruction_set(), threads or count_processors())
        try:
            self._mesh = committed or self._commit(arrays, corners)
        except BaseException:
            self._device.close()
            raise
        # Nobody closes a caster: the process ends, or the last reference.
        weakref.finalize(self, self._device.close)

    def _commit(self, arrays: OwningStruct | None, corners: Floats) -> CommittedScene:
        if arrays is not None:
            return CommittedScene(self._device, arrays)
        # Rays read the hierarchy alone where there are no holes: corners are needed here only.
        owned = corner_arrays(corners, self._centre)
        return CommittedScene(self._device, OwningStruct(owned.struct, ()))

    @classmethod
    def of_scene(cls, scene: SceneMesh) -> KernelMeshCaster:
        """Commit the triangles of a scene, with their holes; errors as of the constructor."""
        if scene.coverage is None:
            committed = _SHARED.get(id(scene.corners))
            caster = cls(scene.corners, scene.centre, committed=committed)
            release_freed_memory()
            return caster
        textures = hole_textures(scene)
        holes = hole_arrays(scene, scene.centre, textures.struct)
        arrays = OwningStruct(holes.struct, (*holes.owners, textures))
        return cls(scene.corners, scene.centre, arrays=arrays)

    def closest_triangles(
        self, origins: Floats, directions: Floats | npt.NDArray[np.float32]
    ) -> tuple[Floats, npt.NDArray[np.int32]]:
        """(n,) distances and triangles; infinite and -1 without a hit."""
        starts = np.ascontiguousarray(origins - self._centre)
        rays = np.ascontiguousarray(directions, dtype=np.float32)
        ranges = np.zeros(len(rays), dtype=np.float32)
        triangles = np.zeros(len(rays), dtype=np.int32)
        self._device.cast(self._mesh.address, starts, rays, ranges, triangles)
        return ranges.astype(np.float64), triangles

    def settle(self, sinking: SinkingStruct) -> int:
        """Let a body come to rest on the triangles; result and errors as of `KernelDevice`."""
        sinking.mesh, sinking.centre = self._mesh.address, tuple(self._centre.tolist())
        return self._device.settle(sinking)

    def separate(self, box: Floats, triangles: Floats) -> Floats:
        """(n,) gaps between a box and (n, 3, 3) triangles, see `simulation/resting.py`.

        Args:
            box: (15,) rotation row by row, middle, half sides.
            triangles: In the same frame as the box.
        """
        gaps = np.empty(len(triangles))
        self._device.separate(box, np.ascontiguousarray(triangles), gaps)
        return gaps


def _release(device: KernelDevice, mesh: int, owned: object) -> None:
    """Free a mesh; the arrays of its holes and materials live until here."""
    device.release_mesh(mesh)
