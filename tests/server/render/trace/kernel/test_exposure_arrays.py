"""Exposures as the kernel's structure, and the table of objects' meshes."""

from __future__ import annotations

import ctypes
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.kernel.exposure_arrays import (
    ObjectTable,
    exposure_arrays,
    ray_table_struct,
)
from catoptra_server.render.trace.kernel.kernel_structs import FrameStruct, MeshArrays
from catoptra_server.render.trace.trace_engine import MovingExposure, TracedExposure
from catoptra_server.world.camera_state import CameraState
from helpers.dynamic_objects import TWO_ROBOTS, place_cube
from helpers.trace_kernels import make_omni_table

FAR = np.array((20e3, -15e3, 300.0))
MIRROR = Pose.from_rpy((0.31, 0.17, -0.6), (0.02, -0.03, 0.3))


class FakeDevice:
    """Device that counts the meshes that it holds."""

    def __init__(self) -> None:
        self.meshes: dict[int, int] = {}
        self.num_commits = 0

    def commit_mesh(self, arrays: MeshArrays) -> int:
        self.num_commits += 1
        self.meshes[1000 * self.num_commits] = arrays.num_triangles
        return 1000 * self.num_commits

    def release_mesh(self, mesh: int) -> None:
        del self.meshes[mesh]


@pytest.fixture
def device() -> FakeDevice:
    return FakeDevice()


@pytest.fixture
def table(device: FakeDevice) -> ObjectTable:
    return ObjectTable(device, np.zeros(3))  # type: ignore[arg-type]


def make_frame(exposure: TracedExposure, table: ObjectTable, centre: Floats) -> FrameStruct:
    """Structure of an exposure; its arrays live on in an attribute."""
    owned = exposure_arrays(exposure, centre, table)
    frame: FrameStruct = owned.struct
    frame.owners = owned.owners  # type: ignore[attr-defined]
    return frame


def read_floats(address: int, shape: tuple[int, ...]) -> Floats:
    """Array at an address."""
    floats = ctypes.cast(address, ctypes.POINTER(ctypes.c_float))
    return np.ctypeslib.as_array(floats, shape).astype(np.float64)


def read_addresses(address: int, count: int) -> list[int]:
    """Addresses at an address."""
    return list(ctypes.cast(address, ctypes.POINTER(ctypes.c_void_p))[:count])  # type: ignore[arg-type]


def test_camera_is_relative_to_the_centre_to_float32_precision(table: ObjectTable) -> None:
    far = Pose.from_rpy(tuple(FAR)) @ MIRROR
    frame = make_frame(CameraState(far), table, FAR)
    assert (frame.num_poses, frame.num_objects, frame.has_shadows) == (1, 0, 0)
    camera = read_floats(frame.camera, (12,))
    np.testing.assert_allclose(camera[:9].reshape(3, 3), MIRROR.rotation, atol=1e-7)
    np.testing.assert_allclose(camera[9:], MIRROR.translation, atol=1e-7)


def test_objects_have_meshes_poses_and_boxes_in_their_order(
    table: ObjectTable, device: FakeDevice
) -> None:
    objects = (*TWO_ROBOTS, place_cube(3.0, 1.0, -0.2))
    state = CameraState(MIRROR, objects, has_shadows=True)
    frame = make_frame(state, table, np.array((1.0, 0.0, 0.0)))
    assert (frame.num_objects, frame.has_shadows) == (3, 1)
    meshes = read_addresses(frame.objects, 3)
    assert meshes[0] == meshes[1] != meshes[2]
    assert [device.meshes[mesh] for mesh in meshes] == [len(o.mesh) for o in objects]
    poses = read_floats(frame.object_poses, (3, 12))
    for placed, pose in zip(objects, poses, strict=True):
        place = placed.world_from_object
        np.testing.assert_allclose(pose[:9].reshape(3, 3), place.rotation, atol=1e-7)
        np.testing.assert_allclose(pose[9:], place.translation - (1.0, 0.0, 0.0), atol=1e-6)
    boxes = read_floats(frame.boxes, (frame.num_boxes, 6))
    box_object = np.ctypeslib.as_array(
        ctypes.cast(frame.box_object, ctypes.POINTER(ctypes.c_int32)), (frame.num_boxes,)
    )
    for index, placed in enumerate(objects):
        own = boxes[box_object == index]
        # Each triangle lies in a box, as Embree's float32 rounds its corners.
        corners = placed.mesh.corners.astype(np.float32).astype(np.float64)
        offsets = np.abs(corners[:, :, None] - own[:, :3])
        assert (offsets <= own[:, 3:]).all(axis=(1, 3)).any(axis=1).all()


def test_poses_of_a_moving_exposure_are_state_by_state(table: ObjectTable) -> None:
    cube, other = place_cube(1.0, 0.0, 0.0), place_cube(2.0, 0.0, 0.0)
    states = [
        CameraState(
            Pose.from_rpy((0.1 * step, 0.0, 0.0)),
            tuple(
                replace(o, world_from_object=Pose.from_rpy((k, step, 0.0)))
                for k, o in enumerate((cube, other))
            ),
        )
        for step in range(3)
    ]
    frame = make_frame(MovingExposure(tuple(states)), table, np.zeros(3))
    assert (frame.num_poses, frame.num_objects) == (3, 2)
    assert read_floats(frame.camera, (3, 12))[:, 9] == pytest.approx([0.0, 0.1, 0.2])
    poses = read_floats(frame.object_poses, (3, 2, 12))
    np.testing.assert_allclose(poses[:, :, 9], [[0.0, 1.0]] * 3)
    np.testing.assert_allclose(poses[:, :, 10], [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]])


def test_mesh_is_committed_once_and_freed_with_the_table(
    table: ObjectTable, device: FakeDevice
) -> None:
    for _ in range(3):
        make_frame(CameraState(MIRROR, TWO_ROBOTS), table, np.zeros(3))
    assert device.num_commits == len(table) == 1
    make_frame(CameraState(MIRROR, (place_cube(1.0, 0.0, 0.0),)), table, np.zeros(3))
    assert device.num_commits == len(table) == 2
    table.close()
    assert device.meshes == {}
    assert len(table) == 0
    table.close()


def test_rays_are_the_table_s_own_arrays() -> None:
    table = make_omni_table(width_px=30, samples=2)
    struct = ray_table_struct(table)
    assert (struct.width_px, struct.height_px, struct.samples) == (30, 30, 2)
    assert (struct.num_tiles, struct.tile_columns) == (len(table.tiles), 8)
    assert struct.tiles == table.tiles.ctypes.data
    assert struct.directions == table.directions.ctypes.data
    assert struct.valid == table.valid.ctypes.data
    assert (struct.origins, struct.times) == (None, None)
    times = np.zeros((*table.valid.shape, 16), dtype=np.float32)
    moving = ray_table_struct(replace(table, origins=table.directions, times=times))
    assert (moving.origins, moving.times) == (table.directions.ctypes.data, times.ctypes.data)
