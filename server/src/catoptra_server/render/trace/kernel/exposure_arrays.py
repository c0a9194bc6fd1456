"""Exposures and rays as the kernel's structures: poses of camera and objects, tables of rays."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.kernel.kernel_library import KernelDevice
from catoptra_server.render.trace.kernel.kernel_structs import FrameStruct, RayTableStruct
from catoptra_server.render.trace.kernel.object_boxes import enclose_parts
from catoptra_server.render.trace.kernel.scene_arrays import Owned, object_arrays
from catoptra_server.render.trace.ray_table import RayTable
from catoptra_server.render.trace.trace_engine import TracedExposure, camera_states
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.objects import ObjectMesh

_NO_BOXES = np.zeros((0, 6), dtype=np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class _CommittedMesh:
    """A mesh of dynamic objects on the kernel's device."""

    address: int
    arrays: Owned
    """Triangles, which the kernel reads."""
    boxes: npt.NDArray[np.float32]
    """(b, 6) centres and half sizes of boxes around its parts."""


class ObjectTable:
    """Meshes of dynamic objects, each committed at its first use."""

    def __init__(self, device: KernelDevice, centre: Floats) -> None:
        """Begin without a mesh.

        Args:
            device: Device of the meshes.
            centre: (3,) centre of the static scene, world frame.
        """
        self._device = device
        self._centre = centre
        self._meshes: dict[ObjectMesh, _CommittedMesh] = {}

    def __len__(self) -> int:
        """Number of meshes."""
        return len(self._meshes)

    def find_mesh(self, mesh: ObjectMesh) -> _CommittedMesh:
        """A mesh, committed."""
        if mesh not in self._meshes:
            owned = object_arrays(mesh)
            boxes = _grow(enclose_parts(mesh)).astype(np.float32)
            self._meshes[mesh] = _CommittedMesh(
                self._device.commit_mesh(owned.struct), owned, boxes
            )
        return self._meshes[mesh]

    def close(self) -> None:
        """Free the meshes."""
        while self._meshes:
            self._device.release_mesh(self._meshes.popitem()[1].address)


def exposure_arrays(exposure: TracedExposure, centre: Floats, table: ObjectTable) -> Owned:
    """Frame without outputs: poses relative to the (3,) centre of the static scene."""
    states = camera_states(exposure)
    exposure_fraction, readout_fraction, max_instants = _shutter_fractions(exposure)
    objects = states[0].objects
    camera = _pose_array([state.world_from_mirror for state in states], centre)
    meshes = [table.find_mesh(placed.mesh) for placed in objects]
    addresses = (ctypes.c_void_p * max(1, len(meshes)))(*(mesh.address for mesh in meshes))
    poses = _pose_array(
        [placed.world_from_object for state in states for placed in state.objects], centre
    )
    boxes = np.concatenate([_NO_BOXES, *(mesh.boxes for mesh in meshes)])
    counts = [len(mesh.boxes) for mesh in meshes]
    box_object = np.repeat(np.arange(len(meshes), dtype=np.int32), counts)
    struct = FrameStruct(
        num_poses=len(states),
        camera=camera.ctypes.data,
        num_objects=len(objects),
        objects=ctypes.addressof(addresses),
        object_poses=poses.ctypes.data,
        num_boxes=len(boxes),
        boxes=boxes.ctypes.data,
        box_object=box_object.ctypes.data,
        has_shadows=states[0].has_shadows,
        exposure=exposure_fraction,
        readout=readout_fraction,
        max_instants=max_instants,
        blur_threshold=-1.0,
    )
    fog = states[0].fog
    if fog is not None:
        struct.fog_density = fog.density_per_m
        struct.airlight[:] = fog.airlight
    return Owned(struct, (camera, addresses, poses, boxes, box_object))


def _shutter_fractions(exposure: TracedExposure) -> tuple[float, float, int]:
    """Exposure and readout times as fractions of both, and the limit of instants; 0 without."""
    shutter = exposure.shutter if isinstance(exposure, CameraState) else None
    if shutter is None:
        return 0.0, 0.0, 0
    total_s = shutter.exposure_s + shutter.readout_s
    return shutter.exposure_s / total_s, shutter.readout_s / total_s, shutter.max_time_samples


def _pose_array(poses: Sequence[Pose], centre: Floats) -> npt.NDArray[np.float32]:
    """(n, 12) rotations, row by row, and translations relative to a centre."""
    array = np.zeros((len(poses), 12), dtype=np.float32)
    for row, pose in zip(array, poses, strict=True):
        row[:9] = pose.rotation.reshape(-1)
        # Subtracted in float64: both positions may be far from the world's origin.
        row[9:] = pose.translation - centre
    return array


def _grow(boxes: Floats) -> Floats:
    """(b, 6) boxes, larger by the rounding of float32."""
    grown = boxes.copy()
    grown[:, 3:] += 1e-5 * (np.abs(boxes[:, :3]) + boxes[:, 3:]) + 1e-6
    return grown


def ray_table_struct(table: RayTable) -> RayTableStruct:
    """Rays of a camera; the kernel reads the table's own arrays."""
    return RayTableStruct(
        width_px=table.width_px,
        height_px=table.height_px,
        samples=table.samples,
        num_tiles=len(table.tiles),
        tile_columns=table.num_tile_columns,
        tiles=table.tiles.ctypes.data,
        directions=table.directions.ctypes.data,
        valid=table.valid.ctypes.data,
        origins=None if table.origins is None else table.origins.ctypes.data,
        times=None if table.times is None else table.times.ctypes.data,
    )
