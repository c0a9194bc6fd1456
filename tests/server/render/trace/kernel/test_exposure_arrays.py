"""Exposures, boxes of objects, labels and flow as the kernel's structures."""

from __future__ import annotations

import ctypes
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.labels import RaySource, build_label_rays
from catoptra_server.render.trace.kernel.exposure_arrays import (
    CentreMatch,
    ObjectTable,
    exposure_arrays,
    flow_arrays,
    label_arrays,
    match_centres,
    ray_table_struct,
)
from catoptra_server.render.trace.kernel.kernel_structs import FrameStruct, MeshArrays
from catoptra_server.render.trace.kernel.library import KernelDevice, KernelUnavailableError
from catoptra_server.render.trace.ray_table import RayTable
from catoptra_server.render.trace.trace_engine import (
    FlowTables,
    LabelRequest,
    LabelTables,
    MovingExposure,
    TracedExposure,
)
from catoptra_server.world.objects import CameraState, ObjectMesh, build_object_mesh
from catoptra_server.world.scene_mesh import MAX_FLOAT_REACH_M, build_scene
from catoptra_server.world.shapes import Patch
from catoptra_server.world.world_description import Item, Material, Rectangle, World
from helpers.dynamic_objects import TWO_ROBOTS, place_cube
from helpers.labelled_rooms import CAMERAS, SIDE_PX
from helpers.trace_kernels import make_omni_table
from measurements.scenes import ROBOT

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
    return ObjectTable(device)  # type: ignore[arg-type]


def make_frame(
    exposure: TracedExposure, table: ObjectTable, centre: Floats, *, side_m: float = 1.0
) -> FrameStruct:
    """Structure of an exposure; its arrays live on in an attribute."""
    pose = Pose.from_rpy(tuple(centre))
    floor = Item("floor", Rectangle((side_m, side_m)), pose, Material((0.5, 0.5, 0.5)))
    owned = exposure_arrays(exposure, build_scene(World("floor", (floor,))), table)
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


@pytest.mark.parametrize(("side_m", "away_m"), [(1.0, 1e4), (3.0 * MAX_FLOAT_REACH_M, 1.0)])
def test_camera_of_a_large_scene_or_far_from_it_is_the_origin(
    table: ObjectTable, side_m: float, away_m: float
) -> None:
    moved = Pose.from_rpy((FAR[0] + away_m, FAR[1], FAR[2])) @ MIRROR
    cube = place_cube(*np.add(moved.translation, (0.0, 0.0, 0.5)))
    frame = make_frame(CameraState(moved, (cube,)), table, FAR, side_m=side_m)
    np.testing.assert_allclose(frame.origin, np.add(MIRROR.translation, (away_m, 0, 0)), atol=1e-9)
    np.testing.assert_array_equal(read_floats(frame.camera, (12,))[9:], np.zeros(3))
    np.testing.assert_allclose(read_floats(frame.object_poses, (12,))[9:], (0, 0, 0.5), atol=1e-7)


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
        # Each triangle lies in a box, as float32 rounds its corners.
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


def test_boxes_of_the_same_meshes_are_gathered_once(table: ObjectTable) -> None:
    moved = tuple(replace(one, world_from_object=MIRROR) for one in TWO_ROBOTS)
    frames = [
        make_frame(CameraState(MIRROR, objects), table, np.zeros(3))
        for objects in (TWO_ROBOTS, TWO_ROBOTS[:1], moved)
    ]
    first, fewer, later = ((f.num_boxes, f.boxes, f.box_object, f.objects) for f in frames)
    assert later == first
    assert fewer[0] == first[0] // 2


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


def make_mesh(corners: Floats) -> ObjectMesh:
    """Mesh of (n, 3, 3) corners."""
    return build_object_mesh(
        [(Patch(corners, np.zeros((len(corners), 3, 2))), Material((1.0, 1.0, 1.0)))]
    )


def surface(boxes: Floats) -> float:
    """Surface of all boxes together."""
    x, y, z = 2.0 * boxes[:, 3:].T
    return float((2.0 * (x * y + y * z + z * x)).sum())


def holds(boxes: Floats, mesh: ObjectMesh) -> bool:
    """Whether each triangle lies in one of the boxes."""
    offsets = np.abs(mesh.corners[:, :, None] - boxes[:, :3])
    return bool((offsets <= boxes[:, 3:] + 1e-12).all(axis=(1, 3)).any(axis=1).all())


def test_robot_with_a_tower_has_boxes_with_much_less_surface_than_one(table: ObjectTable) -> None:
    boxes = table.find_mesh(ROBOT).boxes
    assert holds(boxes, ROBOT)
    one = np.concatenate([ROBOT.centre, ROBOT.half_size_m])[None]
    assert 1 < len(boxes) <= 8
    assert surface(boxes) < 0.75 * surface(one)


@pytest.mark.parametrize("seed", range(5))
def test_boxes_of_random_triangles_hold_all(table: ObjectTable, seed: int) -> None:
    rng = np.random.default_rng(seed)
    centres = rng.choice(rng.uniform(-1.0, 1.0, (4, 3)), 60)
    mesh = make_mesh(centres[:, None] + rng.uniform(-0.1, 0.1, (60, 3, 3)))
    boxes = table.find_mesh(mesh).boxes
    assert holds(boxes, mesh)
    assert 2 <= len(boxes) <= 8


def test_triangles_that_all_overlap_have_one_box_around_them(table: ObjectTable) -> None:
    corners = np.array([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 4.0, 0.0]]])
    for shifts in (np.zeros((1, 1, 1)), np.linspace(0.0, 1e-5, 20)[:, None, None]):
        boxes = table.find_mesh(make_mesh(corners + shifts)).boxes
        # Larger by the rounding of float32.
        np.testing.assert_allclose(boxes, [[1.0, 2.0, 0.0, 1.0, 2.0, 0.0]], atol=1e-4)


CENTRE = np.array((100.0, -50.0, 2.0))
TURN = Pose.from_rpy((0.5, 0.0, 0.0), (0.0, 0.0, 0.3))
FLOW_TABLES = FlowTables(
    points=np.zeros((4, 6, 3), dtype=np.float32),
    ids=np.zeros((4, 6), dtype=np.uint16),
    motions={7: TURN},
    gone={9},
    places=np.linspace(0.1, 0.575, 20),
    radius_px=np.linspace(0.0, 300.0, 20),
    axes=np.eye(2),
    centre_px=(3.0, 2.0),
)


def test_motions_are_about_the_centre_of_the_scene() -> None:
    flow, owned = flow_arrays(FLOW_TABLES, CENTRE)
    assert flow.shape == (4, 6, 2)
    motion_of = (ctypes.c_int32 * 2**16).from_address(owned.struct.motion_of)
    assert [motion_of[number] for number in (0, 7, 8, 9)] == [-1, 0, -1, -2]
    motion = np.array((ctypes.c_float * 12).from_address(owned.struct.motions))
    point = np.array((101.0, -48.0, 1.0))
    moved = motion[:9].reshape(3, 3) @ (point - CENTRE) + motion[9:] + CENTRE
    np.testing.assert_allclose(moved, TURN.transform_points(point), atol=1e-4)


def test_tables_have_even_steps_and_central_cameras_no_origins() -> None:
    _, owned = flow_arrays(FLOW_TABLES, CENTRE)
    assert owned.struct.num_nodes == 20
    np.testing.assert_allclose(owned.struct.nodes_per_unit, 40.0, rtol=1e-6)
    assert owned.struct.origin_r is None


SOURCE = RaySource(CAMERAS["paper"])
CENTRES = build_label_rays(SOURCE, 1)
LABEL_TABLES = LabelTables(*(np.zeros(4, dtype=np.uint16) for _ in range(3)))


def match(table: RayTable, centres: RayTable) -> CentreMatch:
    """Match the centres of pixels with the samples of a view."""
    try:
        device = KernelDevice("avx2", 1)
    except KernelUnavailableError as error:
        pytest.skip(str(error))
    view = device.prepare(ray_table_struct(table))
    try:
        return match_centres(device, view, table, centres)
    finally:
        device.release_view(view)
        device.close()


def test_only_wanted_channels_have_an_address() -> None:
    whole = CentreMatch(CENTRES, np.zeros(4, dtype=np.int32), np.zeros(4, dtype=np.uint8))
    request = LabelRequest(frozenset({"range", "ids"}), LABEL_TABLES, CENTRES)
    arrays, owned = label_arrays(whole, request, CENTRE)
    assert list(arrays) == ["range", "ids"]
    assert arrays["range"].shape == arrays["ids"].shape == (SIDE_PX, SIDE_PX)
    assert owned.struct.range_m == arrays["range"].ctypes.data
    assert owned.struct.normal is None


@pytest.mark.parametrize("samples", [2, 3, 4])
@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_proofs_of_whole_tiles_hold_for_the_centres_of_their_pixels(
    camera: OmniCamera, samples: int
) -> None:
    source = RaySource(camera)
    table, centres = build_label_rays(source, samples), build_label_rays(source, 1)
    found = match(table, centres)
    at = found.centre_tile
    assert (centres.tiles[at[at >= 0]] == table.tiles[at >= 0]).all()
    # Every tile of the centres is that of a tile of samples.
    assert set(at[at >= 0]) == set(range(len(centres.tiles)))
    is_whole = (table.valid == 0xFFFF).all(axis=1)
    # All but tiles around the axis of a mirror, whose rays are too wide for a beam.
    assert np.mean(found.is_held[is_whole]) > 0.98


def test_proof_of_a_tile_does_not_hold_for_a_centre_beyond_its_samples() -> None:
    samples = build_label_rays(SOURCE, 2)
    tile = int(np.flatnonzero((samples.valid == 0xFFFF).all(axis=1))[0])
    valid = samples.valid.copy()
    valid[tile] = [1, 0, 0, 0]  # the sample of a corner alone
    whole, part = match(samples, CENTRES), match(replace(samples, valid=valid), CENTRES)
    assert whole.is_held[tile]
    assert not part.is_held[tile]


def test_tiles_without_a_sample_are_an_error() -> None:
    samples = build_label_rays(SOURCE, 2)
    part = replace(
        samples,
        tiles=samples.tiles[:-3],
        directions=samples.directions[:-3],
        valid=samples.valid[:-3],
    )
    with pytest.raises(DomainError, match=r"[123] tiles of pixels' centres have no sample"):
        match(part, CENTRES)
