"""Optical flow as the kernel's structure."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.trace.flow_tables import NO_MOTION, FlowTables
from catoptra_server.render.trace.kernel.kernel_structs import FlowStruct
from catoptra_server.render.trace.kernel.scene_arrays import Owned
from catoptra_server.render.trace.ray_table import Float32s


def flow_arrays(tables: FlowTables, centre: Floats) -> tuple[Float32s, Owned]:
    """Flow to be written whole, and the structure that names it.

    Args:
        tables: Points, motions and projection.
        centre: (3,) scene's centre in the world.
    """
    flow = np.empty((*tables.ids.shape, 2), dtype=np.float32)
    motion_of = np.full(2**16, NO_MOTION, dtype=np.int32)
    motions = np.zeros((max(1, len(tables.motions)), 12), dtype=np.float32)
    for index, (number, motion) in enumerate(tables.motions.items()):
        motion_of[number] = index
        motions[index, :9] = motion.rotation.reshape(-1)
        # About the scene's centre, in float64: both may be far from the world's origin.
        motions[index, 9:] = motion.transform_points(centre) - centre
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
    )
    struct.centre[:] = centre.tolist()
    struct.axes[:] = tables.axes.reshape(-1).tolist()
    struct.centre_px[:] = tables.centre_px
    return flow, Owned(struct, (points, ids, motion_of, motions, *columns))
