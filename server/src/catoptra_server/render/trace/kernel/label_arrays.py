"""Channels of labels as the kernel's structure."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import numpy.typing as npt

from catoptra_protocol.labels.channels import LABEL_CHANNELS
from catoptra_server.render.trace.kernel.kernel_structs import LabelsStruct
from catoptra_server.render.trace.kernel.scene_arrays import Owned
from catoptra_server.render.trace.label_tables import LabelNumbers, LabelTables
from catoptra_server.render.trace.ray_table import RayTable
from catoptra_server.render.trace.trace_engine import PixelLabels

# Channel of each member of the structure.
_MEMBERS = {
    "range": "range_m",
    "normal": "normal",
    "point": "point",
    "ids": "ids",
    "classes": "classes",
}


def label_arrays(
    table: RayTable, tables: LabelTables, channels: Collection[str]
) -> tuple[PixelLabels, Owned]:
    """Channels to be written, and the structure that names them."""
    arrays = {name: _allocate(table, name) for name in _MEMBERS if name in channels}
    owned = _make_struct(tables)
    for name, array in arrays.items():
        setattr(owned.struct, _MEMBERS[name], array.ctypes.data)
    return arrays, owned


def agreement_arrays(
    table: RayTable, tables: LabelTables, ids: LabelNumbers
) -> tuple[PixelLabels, Owned]:
    """The channel `agreement` to be written, beside the ids that samples are compared with."""
    agreement = _allocate(table, "agreement")
    expected = np.ascontiguousarray(ids)
    owned = _make_struct(tables)
    owned.struct.agreement, owned.struct.expected = agreement.ctypes.data, expected.ctypes.data
    return {"agreement": agreement}, Owned(owned.struct, (*owned.owners, expected))


def _make_struct(tables: LabelTables) -> Owned:
    owners = (tables.triangle_numbers, tables.object_numbers, tables.class_table)
    triangles, objects, classes = (np.ascontiguousarray(one) for one in owners)
    struct = LabelsStruct(
        triangle_numbers=triangles.ctypes.data,
        object_numbers=objects.ctypes.data,
        class_table=classes.ctypes.data,
    )
    return Owned(struct, (triangles, objects, classes))


def _allocate(table: RayTable, name: str) -> npt.NDArray[np.generic]:
    channel = LABEL_CHANNELS[name]
    shape = channel.shape(table.height_px, table.width_px)
    # Pages of zeros come from the system when they are written, the others are written here.
    if channel.nothing == 0.0:
        return np.zeros(shape, dtype=channel.dtype)
    return np.full(shape, channel.nothing, dtype=channel.dtype)
