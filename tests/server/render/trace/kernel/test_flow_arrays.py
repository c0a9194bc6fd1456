"""Flow as the kernel's structure: motions about the scene's centre, numbers without a place."""

from __future__ import annotations

import ctypes

import numpy as np

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.kernel.exposure_arrays import flow_arrays
from catoptra_server.render.trace.trace_engine import FlowTables

CENTRE = np.array((100.0, -50.0, 2.0))
TURN = Pose.from_rpy((0.5, 0.0, 0.0), (0.0, 0.0, 0.3))
TABLES = FlowTables(
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
    flow, owned = flow_arrays(TABLES, CENTRE)
    assert flow.shape == (4, 6, 2)
    motion_of = (ctypes.c_int32 * 2**16).from_address(owned.struct.motion_of)
    assert [motion_of[number] for number in (0, 7, 8, 9)] == [-1, 0, -1, -2]
    motion = np.array((ctypes.c_float * 12).from_address(owned.struct.motions))
    point = np.array((101.0, -48.0, 1.0))
    moved = motion[:9].reshape(3, 3) @ (point - CENTRE) + motion[9:] + CENTRE
    np.testing.assert_allclose(moved, TURN.transform_points(point), atol=1e-4)


def test_tables_have_even_steps_and_central_cameras_no_origins() -> None:
    _, owned = flow_arrays(TABLES, CENTRE)
    assert owned.struct.num_nodes == 20
    np.testing.assert_allclose(owned.struct.nodes_per_unit, 40.0, rtol=1e-6)
    assert owned.struct.origin_r is None
