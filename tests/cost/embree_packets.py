"""Coherent packets of Embree in C, the yardstick of the kernel's bare rays: `embree_packets.c`."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

import numpy as np

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.ray_table import RayTable
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh

SOURCE = Path(__file__).with_name("embree_packets.c")


@cache
def _build_library() -> ctypes.CDLL:
    """The C file, compiled as the kernel is."""
    folder = Path(tempfile.mkdtemp(prefix="catoptra-embree-"))
    command = [sys.executable, "-m", "ziglang", "cc", "-std=c11", "-O3", "-march=native", "-fPIC"]
    command += ["-shared", "-fvisibility=hidden", "-fno-sanitize=undefined", str(SOURCE)]
    subprocess.run([*command, "-o", str(folder / "embree.so")], check=True)
    library = ctypes.CDLL(str(folder / "embree.so"))
    pointer = ctypes.c_void_p
    library.open_yardstick.restype = pointer
    library.open_yardstick.argtypes = (
        ctypes.c_char_p,
        ctypes.c_char_p,
        ctypes.c_int,
        pointer,
        ctypes.c_int,
    )
    library.trace_yardstick.restype = ctypes.c_longlong
    library.trace_yardstick.argtypes = (pointer, pointer, pointer, ctypes.c_int, pointer)
    return library


class EmbreePackets:
    """The triangles of a scene in Embree, with its best instruction set."""

    def __init__(self, scene: SceneMesh, config: str = "") -> None:
        """Commit the triangles; threads end with the process."""
        package = importlib.util.find_spec("embreex")
        if package is None or package.origin is None:
            raise SystemExit("the yardstick needs Embree: pip install embreex")
        folder = Path(package.origin).parents[1] / "embreex.libs"
        path = str(next(folder.glob("libembree4*.so*"))).encode()
        relative = (scene.corners - scene.centre).astype(np.float32).reshape(-1)
        self._centre, self._corners = scene.centre, np.append(relative, np.zeros(4, np.float32))
        threads = len(os.sched_getaffinity(0))
        self._address = _build_library().open_yardstick(
            path, config.encode(), threads, self._corners.ctypes.data, len(scene)
        )
        assert self._address, f"{path!r} lacks a function"

    def trace(self, table: RayTable, state: CameraState) -> int:
        """Trace the rays of a camera; the number that meet something."""
        pose: Pose = state.world_from_mirror
        matrix = np.column_stack((pose.rotation, pose.translation - self._centre))
        rows = np.ascontiguousarray(matrix, dtype=np.float32)
        arrays = (table.directions, table.valid)
        return int(
            _build_library().trace_yardstick(
                self._address,
                *(array.ctypes.data for array in arrays),
                table.valid.size,
                rows.ctypes.data,
            )
        )
