"""What bases rest on, by the native kernel; the definition is `resting.py:ReferenceSupport`."""

from __future__ import annotations

import ctypes

import numpy as np

from catoptra_protocol.optics.elementary import cos, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.kernel.kernel_ray_caster import KernelMeshCaster
from catoptra_server.render.trace.kernel.kernel_structs import (
    REST_NEEDS_TRIANGLES,
    REST_OVER,
    RestingSide,
    SinkingStruct,
    StanceStruct,
)
from catoptra_server.render.trace.kernel.scene_arrays import OwningStruct
from catoptra_server.simulation.resting import FindNear, Rest, Side, Sinking, Stance


class KernelSupport:
    """Twin of `ReferenceSupport`, in a fiftieth of its time."""

    def __init__(self, kernel: KernelMeshCaster) -> None:
        """Rest on the triangles of a kernel."""
        self._kernel = kernel
        # Sides are made once for a class of robots.
        self._sides: dict[int, OwningStruct] = {}

    def separations(self, half: Floats, where: Pose, triangles: Floats) -> Floats:
        """(n,) largest gaps between a box and triangles."""
        return self._kernel.separate(_pack_box(where, half), triangles)

    def settle(self, sinking: Sinking, find_near: FindNear) -> Rest:
        """Where a base comes to rest, or how far it falls; errors as of `KernelMeshCaster`."""
        goal, boxes = _pack_stance(sinking.goal), np.zeros((0, 15))
        before = goal if sinking.before is None else _pack_stance(sinking.before)
        if sinking.boxes:
            boxes = np.array(
                [_pack_box(pose, 0.5 * np.array(size)) for pose, size in sinking.boxes]
            )
        side = self._pack_side(sinking.side)
        job = SinkingStruct(
            side=side,
            boxes=boxes.ctypes.data,
            num_boxes=len(boxes),
            stance=goal,
            goal=goal,
            before=before,
            sink=sinking.sink_m,
            calm=sinking.calm_m,
            floor_z=sinking.floor_z_m,
            contacts=sinking.contacts,
            is_lifted=sinking.before is not None,
        )
        stance = sinking.goal
        while (state := self._kernel.settle(job)) == REST_NEEDS_TRIANGLES:
            stance = _unpack_stance(stance, job.stance)
            triangles = find_near(stance)
            if len(sinking.obstacles):
                triangles = np.concatenate((triangles, sinking.obstacles))
            # The array lives until the next call.
            job.triangles, job.num_triangles = triangles.ctypes.data, len(triangles)
            job.near = job.stance
        stance = _unpack_stance(stance, job.stance)
        if state:
            return Rest(stance, is_over=state == REST_OVER)
        i, j, k = job.contacts
        return Rest(
            stance, (i, j, k), job.touching, job.calm, bool(job.is_even), bool(job.is_on_robot)
        )

    def _pack_side(self, side: Side) -> int:
        """Address of a side as the kernel's structure."""
        found = self._sides.get(id(side))
        if found is None:
            arrays = [
                np.ascontiguousarray(each, dtype=np.float64)
                for each in (side.points, side.lifts, side.wheels_m)
            ]
            counts = len(side.points), len(side.wheels_m)
            addresses = (each.ctypes.data for each in arrays)
            origin = tuple(side.side_from_robot.translation.tolist())
            packed = RestingSide(
                *counts, *addresses, side.half_m, side.rise_m, side.radius_m, origin
            )
            # The side is among the owners: no other gets its id.
            found = self._sides[id(side)] = OwningStruct(packed, (side, *arrays))
        return ctypes.addressof(found.struct)


def _pack_stance(stance: Stance) -> StanceStruct:
    x, y, yaw, z, slope_x, slope_y, _ = stance
    return StanceStruct(x, y, z, slope_x, slope_y, cos(yaw), sin(yaw))


def _unpack_stance(stance: Stance, packed: StanceStruct) -> Stance:
    """Stance at another height and slope."""
    return stance._replace(z_m=packed.z, slope_x=packed.slope_x, slope_y=packed.slope_y)


def _pack_box(pose: Pose, half: Floats) -> Floats:
    """(15,) rotation, middle and half sides."""
    return np.concatenate((pose.rotation.ravel(), pose.translation, half))
