"""Exposures and their outputs as the kernel's structures: poses, objects, rays, labels and flow.

Dynamic objects are meshes of their own, moved by a transform. The kernel traces one only where a
box of it reaches into a part of the image. One box around a robot with a camera tower is mostly
empty: a few boxes around its parts are met by half as many rays. To test an object's triangles
among those that all rays test at once took 1.1 to 1.25 times as long.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from catoptra_protocol.labels import LABEL_CHANNELS
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import EffectChange, Threshold
from catoptra_server.render.trace.kernel.kernel_structs import (
    ChangeLimits,
    FlowStruct,
    FrameStruct,
    LabelsStruct,
    PixelChange,
    RayTableStruct,
)
from catoptra_server.render.trace.kernel.library import KernelDevice
from catoptra_server.render.trace.kernel.scene_arrays import OwningStruct, object_arrays
from catoptra_server.render.trace.ray_table import Float32s, RayTable
from catoptra_server.render.trace.trace_engine import (
    NO_MOTION,
    FlowTables,
    LabelRequest,
    PixelLabels,
    TracedExposure,
    camera_states,
)
from catoptra_server.runtime.memory import LruDict
from catoptra_server.world.objects import CameraState, ObjectMesh, find_body
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import LightProbes

# Every box costs a frame up to six candidates.
_MAX_BOXES = 8
# Sets of objects with arrays of their own: each tile of a multi-view may leave out others.
_MAX_TUPLES = 64
# A division that saves less of the boxes' surface does not pay for the sides that are added.
_LEAST_SAVING = 0.05
_NO_BOXES = np.zeros((0, 6), dtype=np.float32)
# A line of the processor's cache.
_LINE_BYTES = 64
# Member of LabelsStruct of each channel.
_MEMBERS = {"range": "range_m"} | {
    name: name for name in ("normal", "point", "ids", "classes", "agreement")
}
_Order = npt.NDArray[np.intp]


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


def frame_origin(exposure: TracedExposure, scene: SceneMesh) -> Floats:
    """(3,) origin of the coordinates of a frame in the world.

    The scene's centre, so that nothing has to be moved; the camera where float32 is too coarse for
    what is near it, because the scene is large, or the camera far from it.
    """
    camera = camera_states(exposure)[0].world_from_mirror.translation
    return camera if scene.is_large or scene.is_far(camera) else scene.centre


def exposure_arrays(
    exposure: TracedExposure,
    scene: SceneMesh,
    table: ObjectTable,
    probes: LightProbes | None = None,
) -> OwningStruct:
    """Frame without outputs: poses relative to its origin; light of objects by probes."""
    states = camera_states(exposure)
    origin = frame_origin(exposure, scene)
    exposure_fraction, readout_fraction, max_instants = _shutter_fractions(exposure)
    objects = table.find_objects(tuple(placed.mesh for placed in states[0].objects))
    # Of the camera, then of the objects, each state by state.
    poses = [state.world_from_mirror for state in states]
    poses += [placed.world_from_object for state in states for placed in state.objects]
    array = _pose_array(poses, origin)
    struct = FrameStruct.from_buffer_copy(objects.struct)
    struct.origin[:] = origin - scene.centre
    struct.num_poses = len(states)
    struct.camera = array.ctypes.data
    struct.object_poses = struct.camera + len(states) * array.strides[0]
    struct.has_shadows = states[0].has_shadows
    struct.has_gloss = states[0].has_gloss
    struct.exposure = exposure_fraction
    struct.readout = readout_fraction
    struct.max_instants = max_instants
    struct.blur_threshold = -1.0
    struct.least_gain = struct.largest_gain = 1.0
    light = None
    if probes is not None and states[0].objects:
        lights = [probes.find_light(placed.centre).faces for placed in states[0].objects]
        light = np.array(lights, dtype=np.float32)
        struct.object_light = light.ctypes.data
    shades = None
    if scene.baked_light is not None and states[0].has_baked_light and states[0].objects:
        boxes = [find_body(placed.mesh) for placed in states[0].objects]
        shades = np.array(boxes, dtype=np.float32)
        struct.shades = shades.ctypes.data
    fog = states[0].fog
    if fog is not None:
        struct.fog_density = fog.density_per_m
        struct.airlight[:] = fog.airlight
    return OwningStruct(struct, (array, objects, light, shades))


def change_limits(threshold: Threshold, num_pixels: int, spread: int = 1) -> ChangeLimits:
    """Change of an image of some pixels that nobody misses.

    Args:
        spread: Pixels of the picture that one of the image's may change.
    """
    # What counts some pixels twice decides nothing where all of them may change.
    share = threshold.visible_share
    max_visible = int(share * num_pixels / spread) if share < 1.0 else 2**31 - 1
    return ChangeLimits(threshold.max_change, threshold.plain_change, max_visible)


def read_change(change: PixelChange, num_pixels: int, spread: int = 1) -> EffectChange:
    """Change that the kernel found in an image of some pixels."""
    return EffectChange(change.largest, min(spread * change.num_visible / num_pixels, 1.0))


def _shutter_fractions(exposure: TracedExposure) -> tuple[float, float, int]:
    """Exposure and readout times as fractions of both, and the limit of instants; 0 without."""
    shutter = exposure.shutter if isinstance(exposure, CameraState) else None
    if shutter is None:
        return 0.0, 0.0, 0
    # The kernel knows no seconds, only places between the first pose and the last.
    total_s = shutter.exposure_s + shutter.readout_s
    return shutter.exposure_s / total_s, shutter.readout_s / total_s, shutter.max_time_samples


def _pose_array(poses: Sequence[Pose], centre: Floats) -> npt.NDArray[np.float32]:
    """(n, 12) rotations, row by row, and translations relative to a centre."""
    array = np.zeros((len(poses), 12), dtype=np.float32)
    array[:, :9] = np.array([pose.rotation for pose in poses]).reshape(-1, 9)
    # Subtracted in float64: both positions may be far from the world's origin.
    array[:, 9:] = np.array([pose.translation for pose in poses]) - centre
    return array


class ObjectTable:
    """Meshes of dynamic objects, each committed at its first use."""

    def __init__(self, device: KernelDevice) -> None:
        """Begin without a mesh."""
        self._device = device
        # By identity: robots of one class share a mesh.
        self._meshes: dict[ObjectMesh, _CommittedMesh] = {}
        self._objects: LruDict[tuple[ObjectMesh, ...], OwningStruct] = LruDict(_MAX_TUPLES)

    def __len__(self) -> int:
        """Number of meshes."""
        return len(self._meshes)

    def find_mesh(self, mesh: ObjectMesh) -> _CommittedMesh:
        """A mesh, committed."""
        if mesh not in self._meshes:
            owned = object_arrays(mesh)
            boxes = _grow(_enclose_parts(mesh)).astype(np.float32)
            self._meshes[mesh] = _CommittedMesh(
                self._device.commit_mesh(owned.struct), owned, boxes
            )
        return self._meshes[mesh]

    def find_objects(self, meshes: tuple[ObjectMesh, ...]) -> OwningStruct:
        """Frame with objects of these meshes, without poses: made once for all frames."""
        return self._objects.get_or_make(meshes, lambda: self._object_arrays(meshes))

    def _object_arrays(self, meshes: tuple[ObjectMesh, ...]) -> OwningStruct:
        committed = [self.find_mesh(mesh) for mesh in meshes]
        addresses = (ctypes.c_void_p * max(1, len(meshes)))(*(mesh.address for mesh in committed))
        boxes = np.concatenate([_NO_BOXES, *(mesh.boxes for mesh in committed)])
        counts = [len(mesh.boxes) for mesh in committed]
        box_object = np.repeat(np.arange(len(meshes), dtype=np.int32), counts)
        struct = FrameStruct(
            num_objects=len(meshes),
            objects=ctypes.addressof(addresses),
            num_boxes=len(boxes),
            boxes=boxes.ctypes.data,
            box_object=box_object.ctypes.data,
        )
        return OwningStruct(struct, (addresses, boxes, box_object))

    def close(self) -> None:
        """Free the meshes."""
        self._objects.clear()
        while self._meshes:
            self._device.release_mesh(self._meshes.popitem()[1].address)


@dataclass(frozen=True, slots=True, eq=False)
class _CommittedMesh:
    """A mesh of dynamic objects on the kernel's device."""

    address: int
    arrays: OwningStruct
    """Triangles, which the kernel reads."""
    boxes: npt.NDArray[np.float32]
    """(b, 6) centres and half sizes of boxes around its parts."""


def _grow(boxes: Floats) -> Floats:
    """(b, 6) boxes, larger by the rounding of float32."""
    grown = boxes.copy()
    grown[:, 3:] += 1e-5 * (np.abs(boxes[:, :3]) + boxes[:, 3:]) + 1e-6
    return grown


def _enclose_parts(mesh: ObjectMesh) -> Floats:
    """(b, 6) centres and half sizes of boxes that together hold a mesh, in its frame, metres."""
    low, high = mesh.corners.min(axis=1), mesh.corners.max(axis=1)
    parts = [np.arange(len(mesh))]
    while len(parts) < _MAX_BOXES:
        areas = [_area(low[part].min(axis=0), high[part].max(axis=0)) for part in parts]
        divisions = [_divide(low[part], high[part]) for part in parts]
        savings = [area - after for area, (after, _) in zip(areas, divisions, strict=True)]
        best = int(np.argmax(savings))
        if savings[best] <= _LEAST_SAVING * sum(areas):
            break
        part, (_, (first, second)) = parts[best], divisions[best]
        parts[best : best + 1] = [part[first], part[second]]
    bounds = [(low[part].min(axis=0), high[part].max(axis=0)) for part in parts]
    return np.array([(*(0.5 * (a + b)), *(0.5 * (b - a))) for a, b in bounds])


def _divide(low: Floats, high: Floats) -> tuple[float, tuple[_Order, _Order]]:
    """Division of (n, 3) boxes of triangles in two with the least surface, and that surface."""
    best: tuple[float, tuple[_Order, _Order]] = (math.inf, (np.arange(0), np.arange(0)))
    for axis in range(3):
        order = np.argsort(low[:, axis] + high[:, axis], kind="stable")
        first = _running_area(low[order], high[order])[:-1]
        second = _running_area(low[order[::-1]], high[order[::-1]])[::-1][1:]
        if len(first) and (first + second).min() < best[0]:
            split = int((first + second).argmin()) + 1
            best = float((first + second).min()), (order[:split], order[split:])
    return best


def _running_area(low: Floats, high: Floats) -> Floats:
    """Surface of the box around the first 1, 2, ... n boxes."""
    return _area(np.minimum.accumulate(low), np.maximum.accumulate(high))


def _area(low: Floats, high: Floats) -> Floats:
    """Surface of boxes between (..., 3) corners."""
    x, y, z = np.moveaxis(high - low, -1, 0)
    area: Floats = 2.0 * (x * y + y * z + z * x)
    return area


@dataclass(frozen=True, slots=True, eq=False)
class CentreMatch:
    """Where the rays of the pixels' centres are among the tiles of a view."""

    centres: RayTable
    centre_tile: npt.NDArray[np.int32]
    """(t,) tile of the centres of each tile of the view; -1 for none."""
    is_held: npt.NDArray[np.uint8]
    """(t,) whether proofs about a tile of the view hold for the centres' rays, too."""


def match_centres(
    device: KernelDevice, view: int, table: RayTable, centres: RayTable
) -> CentreMatch:
    """Match the rays of pixels' centres with the rays of a view; once for all frames.

    Args:
        device: Device of the view.
        view: The view.
        table: Rays of the view.
        centres: Rays of the pixels' centres of the same image.

    Raises:
        DomainError: Tiles of the centres are missing in the view.
    """
    centre_tile = np.arange(len(table.tiles), dtype=np.int32)
    is_held = np.ones(len(table.tiles), dtype=np.uint8)
    if table is not centres:
        device.match_centres(view, ray_table_struct(centres), centre_tile, is_held)
    return CentreMatch(centres, centre_tile, is_held)


def label_arrays(
    match: CentreMatch, request: LabelRequest, origin: Floats
) -> tuple[PixelLabels, OwningStruct]:
    """Channels to be written, and the structure with the addresses; origin as of the frame."""
    arrays = _allocate(match.centres, [name for name in _MEMBERS if name in request.channels])
    tables = request.tables
    numbers = (tables.triangle_numbers, tables.object_numbers, tables.class_table)
    triangles, objects, classes = (np.ascontiguousarray(one) for one in numbers)
    struct = LabelsStruct(
        centres=ray_table_struct(match.centres),
        centre_tile=match.centre_tile.ctypes.data,
        is_held=match.is_held.ctypes.data,
        triangle_numbers=triangles.ctypes.data,
        object_numbers=objects.ctypes.data,
        class_table=classes.ctypes.data,
        centre=tuple(origin),
    )
    for name, array in arrays.items():
        setattr(struct, _MEMBERS[name], array.ctypes.data)
    return arrays, OwningStruct(struct, (match, triangles, objects, classes))


def _allocate(table: RayTable, names: Sequence[str]) -> PixelLabels:
    """Channels, which the kernel writes whole.

    All in one block: NumPy asks for huge pages for large ones, and tiles are written to rows in so
    many pages that the processor would look up more of them than values.
    """
    shapes = {name: LABEL_CHANNELS[name].shape(table.height_px, table.width_px) for name in names}
    dtypes = {name: np.dtype(LABEL_CHANNELS[name].dtype) for name in names}
    sizes = {name: math.prod(shapes[name]) * dtypes[name].itemsize for name in names}
    block = np.empty(sum(map(_whole_lines, sizes.values())), dtype=np.uint8)
    arrays, begin = {}, 0
    for name in names:
        part = block[begin : begin + sizes[name]]
        arrays[name] = part.view(dtypes[name]).reshape(shapes[name])
        begin += _whole_lines(sizes[name])
    return arrays


def _whole_lines(size: int) -> int:
    """Size of whole lines of the cache: no two channels share one."""
    return -(-size // _LINE_BYTES) * _LINE_BYTES


def flow_arrays(tables: FlowTables, origin: Floats) -> tuple[Float32s, OwningStruct]:
    """Flow to be written whole, and the structure with the addresses.

    Args:
        tables: Points, motions and projection.
        origin: (3,) as of `frame_origin`.
    """
    flow = np.empty((*tables.ids.shape, 2), dtype=np.float32)
    motion_of = np.full(2**16, NO_MOTION, dtype=np.int32)
    motions = np.zeros((max(1, len(tables.motions)), 12), dtype=np.float32)
    for index, (number, motion) in enumerate(tables.motions.items()):
        motion_of[number] = index
        motions[index, :9] = motion.rotation.reshape(-1)
        # About the frame's origin, in float64: both may be far from the world's.
        motions[index, 9:] = motion.transform_points(origin) - origin
    motion_of[list(tables.gone)] = NO_MOTION - 1
    points = np.ascontiguousarray(tables.points, dtype=np.float32)
    ids = np.ascontiguousarray(tables.ids, dtype=np.uint16)
    columns = [
        None if column is None else np.ascontiguousarray(column, dtype=np.float32)
        for column in (tables.radius_px, tables.origin_r, tables.origin_z)
    ]
    addresses = [None if column is None else column.ctypes.data for column in columns]
    places = tables.places
    struct = FlowStruct(
        points=points.ctypes.data,
        ids=ids.ctypes.data,
        motion_of=motion_of.ctypes.data,
        motions=motions.ctypes.data,
        num_nodes=len(places),
        first=places[0],
        last=places[-1],
        nodes_per_unit=(len(places) - 1) / (places[-1] - places[0]),
        radius_px=addresses[0],
        origin_r=addresses[1],
        origin_z=addresses[2],
        flow=flow.ctypes.data,
        centre=tuple(origin),
        axes=tuple(tables.axes.reshape(-1)),
        centre_px=tables.centre_px,
    )
    return flow, OwningStruct(struct, (points, ids, motion_of, motions, *columns))
