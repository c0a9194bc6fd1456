"""Fraction of each object that others hide: of the pixels that it would have alone in the world.

Rays of pixels in a cone around the object's box are cast at its own triangles. At most MAX_RAYS of
them, evenly spread over the image, decide: the standard error of the fraction is then below 0.01.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from catoptra_protocol.labels.channels import LabelledObject
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.ground_truth.label_rays import mask_of_rays
from catoptra_server.ground_truth.scene_labels import SceneLabels
from catoptra_server.render.trace.kernel.kernel_ray_caster import KernelMeshCaster
from catoptra_server.render.trace.kernel.library import AUTO
from catoptra_server.render.trace.ray_table import RayTable
from catoptra_server.render.trace.reference.meshes import EmbreeMesh
from catoptra_server.render.trace.trace_engine import assemble_grid
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.objects import ObjectMesh
from catoptra_server.world.scene_mesh import SceneMesh

MAX_RAYS = 4096

# Whether rays from (n, 3) origins along (n, 3) unit directions meet an object.
_RayTest = Callable[[Floats, Floats], Bools]


class PixelRayGrid:
    """Rays of the pixels' centres in the mirror frame."""

    def __init__(self, table: RayTable) -> None:
        """Arrange the rays of a table of one sample a pixel."""
        fill = np.float32(0.0)
        self.directions = assemble_grid(table, np.moveaxis(table.directions, 2, -1), fill=fill)
        """(h, w, 3) unit; +z where invalid."""
        self.origins = np.zeros_like(self.directions)
        """(h, w, 3) metres."""
        if table.origins is not None:
            self.origins = assemble_grid(table, np.moveaxis(table.origins, 2, -1), fill=fill)
        self.valid = mask_of_rays(table)
        """(h, w) mask."""
        self.max_miss_m = float(np.linalg.norm(self.origins, axis=-1).max(initial=0.0))
        """Largest distance of an origin from the viewpoint."""


class OcclusionMeter:
    """Occluded fractions of the objects of one world; meshes are committed at their first use."""

    def __init__(self, scene: SceneMesh, labels: SceneLabels, instruction_set: str = AUTO) -> None:
        """Measure nothing yet.

        Args:
            scene: The world's triangles.
            labels: Their objects.
            instruction_set: Of the rays; "auto": by embreex, as the processor has it, without the
                kernel. The last bits decide whether a ray along an edge meets it.
        """
        self._scene = scene
        self._labels = labels
        self._instruction_set = instruction_set
        self._static: dict[int, _RayTest] = {}
        self._moving: dict[ObjectMesh, _RayTest] = {}

    def measure(
        self,
        objects: tuple[LabelledObject, ...],
        ids: npt.NDArray[np.uint16],
        rays: PixelRayGrid,
        camera_state: CameraState,
    ) -> dict[int, float]:
        """Occluded fraction of each object in view, by number.

        Args:
            objects: All objects of the exposure.
            ids: (h, w) numbers that the pixels' centres meet.
            rays: Rays of the pixels.
            camera_state: The exposure; its middle counts.
        """
        placed = {self._labels.number_of(one): one for one in camera_state.objects}
        in_view = np.bincount(ids.reshape(-1), minlength=2**16) > 0
        fractions = {}
        for one in objects:
            if not in_view[one.number]:
                continue
            robot = placed.get(one.number)
            mesh = self._find_static(one.number) if robot is None else self._find(robot.mesh)
            pose = Pose.identity() if robot is None else robot.world_from_object
            object_from_mirror = pose.inverse() @ camera_state.world_from_mirror
            centre = camera_state.world_from_mirror.inverse().transform_points(
                one.world_from_box.translation
            )
            pixels = _candidates(rays, centre, float(np.linalg.norm(one.half_size_m)))
            fractions[one.number] = _hidden_fraction(
                mesh, rays, pixels, object_from_mirror, ids.reshape(-1)[pixels] == one.number
            )
        return fractions

    def _find_static(self, number: int) -> _RayTest:
        if number not in self._static:
            triangles = self._labels.triangle_numbers == number
            self._static[number] = self._commit(self._scene.corners[triangles])
        return self._static[number]

    def _find(self, mesh: ObjectMesh) -> _RayTest:
        if mesh not in self._moving:
            self._moving[mesh] = self._commit(mesh.corners)
        return self._moving[mesh]

    def _commit(self, corners: Floats) -> _RayTest:
        """Test whether rays meet some triangles, at least one."""
        if self._instruction_set == AUTO:
            mesh = EmbreeMesh(corners)
            return lambda origins, ways: np.isfinite(mesh.first_hits(origins, ways).distance)
        centre = 0.5 * (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1)))
        caster = KernelMeshCaster(corners, centre, instruction_set=self._instruction_set, threads=1)
        return lambda origins, ways: caster.closest_triangles(origins, ways)[1] >= 0


def _candidates(rays: PixelRayGrid, centre: Floats, radius_m: float) -> npt.NDArray[np.intp]:
    """Numbers of at most MAX_RAYS pixels whose rays may meet a sphere in the mirror frame."""
    possible = rays.valid.reshape(-1)
    distance = float(np.linalg.norm(centre))
    reach = radius_m + rays.max_miss_m
    if distance > reach:
        cosine = math.cos(min(math.pi, math.asin(reach / distance) + 1e-3))
        along = rays.directions.reshape(-1, 3) @ (centre / distance).astype(np.float32)
        possible = possible & (along >= cosine)
    pixels = np.flatnonzero(possible)
    step = len(pixels) / MAX_RAYS
    return pixels if step <= 1.0 else pixels[(np.arange(MAX_RAYS) * step).astype(np.intp)]


def _hidden_fraction(
    meets: _RayTest,
    rays: PixelRayGrid,
    pixels: npt.NDArray[np.intp],
    object_from_mirror: Pose,
    is_visible: Bools,
) -> float:
    """Fraction of the pixels whose rays meet a mesh that do not show it."""
    starts, ways = (
        grid.reshape(-1, 3)[pixels].astype(np.float64) for grid in (rays.origins, rays.directions)
    )
    origins = object_from_mirror.transform_points(starts)
    directions = object_from_mirror.rotate_directions(ways)
    own = meets(origins, directions) | is_visible
    # In view by pixels between those that are cast: nothing is known to be hidden.
    return 1.0 - float(is_visible.sum() / own.sum()) if own.any() else 0.0
