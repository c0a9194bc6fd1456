"""Channels of labels as the kernel's structure, and the rays that they are found along."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from catoptra_protocol.labels.channels import LABEL_CHANNELS
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.trace.kernel.exposure_arrays import ray_table_struct
from catoptra_server.render.trace.kernel.kernel_library import KernelDevice
from catoptra_server.render.trace.kernel.kernel_structs import LabelsStruct
from catoptra_server.render.trace.kernel.scene_arrays import Owned
from catoptra_server.render.trace.label_tables import LabelRequest
from catoptra_server.render.trace.ray_table import RayTable
from catoptra_server.render.trace.trace_engine import PixelLabels

# Channel of each member of the structure.
_MEMBERS = {
    "range": "range_m",
    "normal": "normal",
    "point": "point",
    "ids": "ids",
    "classes": "classes",
    "agreement": "agreement",
}

_LINE_BYTES = 64


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
    """Match the rays of pixels' centres with those of a view; once for all frames.

    Args:
        device: Device of the view.
        view: The view.
        table: Rays of the view.
        centres: Rays of the pixels' centres of the same image.

    Raises:
        DomainError: The view lacks tiles of the centres.
    """
    centre_tile = np.arange(len(table.tiles), dtype=np.int32)
    is_held = np.ones(len(table.tiles), dtype=np.uint8)
    if table is not centres:
        device.match_centres(view, ray_table_struct(centres), centre_tile, is_held)
    return CentreMatch(centres, centre_tile, is_held)


def label_arrays(match: CentreMatch, request: LabelRequest) -> tuple[PixelLabels, Owned]:
    """Channels to be written, and the structure that names them."""
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
    )
    for name, array in arrays.items():
        setattr(struct, _MEMBERS[name], array.ctypes.data)
    return arrays, Owned(struct, (match, triangles, objects, classes))


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
