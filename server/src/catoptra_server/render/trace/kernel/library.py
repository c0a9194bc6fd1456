"""The kernel's library: chosen for the processor, loaded, checked, and called.

There is one for each of three instruction sets of x86-64, and one for ARM, which differ in speed
alone: all compute the same bytes. Where the files are missing, the server traces with its
reference, and
`KernelUnavailableError` is the reason.

ctypes releases the GIL for the whole of a call: the other threads of the server run while a frame
is rendered.
"""

from __future__ import annotations

import ctypes
import os
import platform
from collections.abc import Callable
from ctypes import c_int32, c_int64, c_void_p
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import CatoptraError, DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.trace.kernel.kernel_structs import (
    REST_NO_MEMORY,
    STRUCTURES,
    BakeJob,
    FacetSource,
    FrameCounts,
    FrameStruct,
    GatherJob,
    ImageJob,
    MeshArrays,
    RayTableStruct,
    SceneStruct,
    SinkingStruct,
)

_CPU_INFO = Path("/proc/cpuinfo")
# What each library of x86-64 requires of a processor, in the words of the system's list, the best
# first. SSE4.2 is assumed, as NEON is on ARM.
_REQUIRED_FLAGS = {
    "avx512": {"avx512f", "avx512dq", "avx512cd", "avx512bw", "avx512vl"},
    "avx2": {"avx2", "fma", "f16c", "bmi1", "bmi2"},
}
# The same names as in build_kernel.py, which compiles the kernel once for each processor.
LIBRARY_OF_INSTRUCTION_SET = {
    "neon": "libcatoptra_trace.so",
    "sse4.2": "libcatoptra_trace.so",
    "avx2": "libcatoptra_trace_avx2.so",
    "avx512": "libcatoptra_trace_avx512.so",
}
# Written by build_kernel.py where nothing could be built.
REASON_NAME = "not_built.txt"
# ERROR_SIZE of `src/device.h`.
_ERROR_BYTES = 256
_Float32s = npt.NDArray[np.float32]


class KernelUnavailableError(CatoptraError):
    """The native kernel cannot trace here; the message names the missing part and the remedy."""

    def __init__(self, reason: str) -> None:
        super().__init__(f"no native kernel: {reason}")
        self.reason = reason


class KernelError(CatoptraError):
    """The kernel failed, such as for lack of memory; the message has the reason."""


class KernelDevice:
    """The kernel's threads.

    Meshes and views are addresses that belong to the device; all are released before it closes.
    """

    def __init__(self, instruction_set: str, threads: int) -> None:
        """Open a device.

        Args:
            instruction_set: One that this processor has.
            threads: Threads, the calling one included.

        Raises:
            KernelUnavailableError: The library is missing.
        """
        self._library = _load_library(kernel_library_path(instruction_set))
        self._address: int | None = None
        error = ctypes.create_string_buffer(_ERROR_BYTES)
        self._address = self._library.catoptra_open(threads, error)
        if not self._address:
            raise KernelUnavailableError(error.value.decode(errors="replace"))

    def commit_mesh(self, arrays: MeshArrays) -> int:
        """Commit triangles for ray queries."""
        return self._make(self._library.catoptra_commit_mesh, arrays)

    def release_mesh(self, mesh: int) -> None:
        """Free a mesh."""
        self._library.catoptra_release_mesh(mesh)

    def repaint_mesh(self, mesh: int, arrays: MeshArrays) -> None:
        """Give the triangles of a mesh other looks; the arrays outlive the mesh, or the next."""
        self._library.catoptra_repaint_mesh(mesh, ctypes.byref(arrays))

    def find_surfaces(
        self,
        facets: FacetSource,
        surface: npt.NDArray[np.int32],
        outer_edges: npt.NDArray[np.uint8],
        representative: npt.NDArray[np.int32],
    ) -> int:
        """Write the flat surfaces of n triangles into (n,) arrays; their number.

        Raises:
            KernelError: Memory is short.
        """
        addresses = (array.ctypes.data for array in (surface, outer_edges, representative))
        count: int = self._library.catoptra_find_surfaces(
            self._require_open(), ctypes.byref(facets), *addresses
        )
        if count < 0:
            raise KernelError("no flat surfaces: out of memory")
        return count

    def prepare(self, rays: RayTableStruct) -> int:
        """Prepare the rays of a view."""
        return self._make(self._library.catoptra_prepare, rays)

    def _make(self, function: Callable[..., int | None], description: ctypes.Structure) -> int:
        """Address of what the kernel makes of a description."""
        error = ctypes.create_string_buffer(_ERROR_BYTES)
        address = function(self._require_open(), ctypes.byref(description), error)
        if not address:
            raise KernelError(error.value.decode(errors="replace"))
        return address

    def view_bytes(self, view: int) -> int:
        """Size of a view, without the rays."""
        return int(self._library.catoptra_view_bytes(view))

    def release_view(self, view: int) -> None:
        """Free a view."""
        self._library.catoptra_release_view(view)

    def match_centres(
        self,
        view: int,
        centres: RayTableStruct,
        centre_tile: npt.NDArray[np.int32],
        is_held: npt.NDArray[np.uint8],
    ) -> None:
        """Match the rays of pixels' centres with the rays of a view of the same image.

        Args:
            view: A view.
            centres: Rays of the pixels' centres.
            centre_tile: (t,) receives the centres' tile of each of the view's tiles; -1: none.
            is_held: (t,) receives whether proofs about the view's tile hold for the centres' rays.

        Raises:
            DomainError: Tiles of the centres are missing in the view.
            KernelError: Memory is short.
        """
        addresses = (centre_tile.ctypes.data, is_held.ctypes.data)
        unmatched = self._library.catoptra_match_centres(view, ctypes.byref(centres), *addresses)
        if unmatched < 0:
            raise KernelError("no labels: out of memory")
        if unmatched:
            raise DomainError(f"{unmatched} tiles of pixels' centres have no sample")

    def cast(
        self,
        mesh: int,
        origins: Floats,
        directions: _Float32s,
        ranges: _Float32s,
        triangles: npt.NDArray[np.int32],
    ) -> None:
        """Write first hits of single rays; any threads may cast at once.

        Args:
            mesh: A mesh of this device.
            origins: (n, 3) points, contiguous as all arrays here.
            directions: (n, 3) unit vectors.
            ranges: (n,) receives the distances, metres; inf without a hit.
            triangles: (n,) receives the triangles; -1 without a hit.
        """
        self._require_open()  # the mesh belongs to the device
        arrays = (origins, directions, ranges, triangles)
        self._library.catoptra_cast(mesh, len(origins), *(array.ctypes.data for array in arrays))

    def settle(self, sinking: SinkingStruct) -> int:
        """Let a body come to rest, and say how: one of REST_FOUND and the others.

        Raises:
            KernelError: Memory is short.
        """
        self._require_open()  # the mesh belongs to the device
        state: int = self._library.catoptra_settle(ctypes.byref(sinking))
        if state == REST_NO_MEMORY:
            raise KernelError("no resting place: out of memory")
        return state

    def separate(self, box: Floats, triangles: Floats, gaps: Floats) -> None:
        """Write the (n,) gaps between a box (15,) and (n, 3, 3) triangles, all contiguous."""
        addresses = (triangles.ctypes.data, gaps.ctypes.data)
        self._library.catoptra_separate(box.ctypes.data, len(gaps), *addresses)

    def build_light_maps(self, scene: SceneStruct) -> int | None:
        """Maps of where nothing occludes a scene's directional lights; None if memory is short."""
        self._require_open()  # the scene's mesh belongs to the device
        address: int | None = self._library.catoptra_build_light_maps(ctypes.byref(scene))
        return address

    def release_light_maps(self, scene: SceneStruct) -> None:
        """Free a scene's light maps."""
        self._library.catoptra_release_light_maps(scene.light_maps, scene.num_lights)
        scene.light_maps = None

    def render(self, scene: SceneStruct, view: int, frame: FrameStruct) -> FrameCounts:
        """Render a frame into its outputs."""
        error, counts = ctypes.create_string_buffer(_ERROR_BYTES), FrameCounts()
        arguments = (ctypes.byref(scene), view, ctypes.byref(frame), ctypes.byref(counts))
        if self._library.catoptra_render(self._require_open(), *arguments, error):
            raise KernelError(f"no frame: {error.value.decode(errors='replace')}")
        return counts

    def trace(self, scene: SceneStruct, view: int, frame: FrameStruct) -> None:
        """Trace a view's rays without any use of the hits: the bare rate."""
        error = ctypes.create_string_buffer(_ERROR_BYTES)
        arguments = (ctypes.byref(scene), view, ctypes.byref(frame))
        self._library.catoptra_trace(self._require_open(), *arguments, error)

    def bake(self, job: BakeJob) -> None:
        """Cast one pass of rays from nodes, into the arrays of a job."""
        self._library.catoptra_bake(self._require_open(), ctypes.byref(job))

    def gather(self, job: GatherJob) -> None:
        """Write the means of radiance over stored hits."""
        self._library.catoptra_gather(self._require_open(), ctypes.byref(job))

    def change_image(self, job: ImageJob) -> None:
        """Change an image by the stages of a job, into its outputs.

        Args:
            job: Job whose scratch has `image_scratch_bytes`.
        """
        self._library.catoptra_change_image(self._require_open(), ctypes.byref(job))

    def image_scratch_bytes(self, job: ImageJob) -> int:
        """Size of the memory that a job works in."""
        return int(self._library.catoptra_image_scratch(ctypes.byref(job)))

    def _require_open(self) -> int:
        """Address of the device, which the kernel does not check."""
        if self._address is None:
            raise KernelError("the device is closed: nothing can be rendered with it")
        return self._address

    def close(self) -> None:
        """End the threads and free the device."""
        if self._address:
            self._library.catoptra_close(self._address)
        self._address = None


@cache
def _load_library(path: Path) -> ctypes.CDLL:
    """Library with its functions' types, checked against the structures of this release."""
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise KernelUnavailableError(f"{path} cannot be loaded: {error}") from None
    signatures = {
        "catoptra_abi": (c_int32, (c_int32,)),
        "catoptra_open": (c_void_p, (c_int32, c_void_p)),
        "catoptra_close": (None, (c_void_p,)),
        "catoptra_commit_mesh": (c_void_p, (c_void_p, c_void_p, c_void_p)),
        "catoptra_cast": (None, (c_void_p, c_int64, *(c_void_p,) * 4)),
        "catoptra_settle": (c_int32, (c_void_p,)),
        "catoptra_separate": (None, (c_void_p, c_int64, c_void_p, c_void_p)),
        "catoptra_release_mesh": (None, (c_void_p,)),
        "catoptra_repaint_mesh": (None, (c_void_p, c_void_p)),
        "catoptra_find_surfaces": (c_int32, (c_void_p,) * 5),
        "catoptra_prepare": (c_void_p, (c_void_p, c_void_p, c_void_p)),
        "catoptra_view_bytes": (c_int64, (c_void_p,)),
        "catoptra_release_view": (None, (c_void_p,)),
        "catoptra_match_centres": (c_int32, (c_void_p,) * 4),
        "catoptra_build_light_maps": (c_void_p, (c_void_p,)),
        "catoptra_release_light_maps": (None, (c_void_p, c_int32)),
        "catoptra_render": (c_int32, (c_void_p,) * 6),
        "catoptra_change_image": (None, (c_void_p, c_void_p)),
        "catoptra_image_scratch": (c_int64, (c_void_p,)),
        "catoptra_trace": (c_int32, (c_void_p,) * 5),
        "catoptra_bake": (None, (c_void_p, c_void_p)),
        "catoptra_gather": (None, (c_void_p, c_void_p)),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, name, None)
        if function is None:
            raise KernelUnavailableError(f"{path} has no function {name}; install the server again")
        function.restype, function.argtypes = result, arguments
    for number, structure in enumerate(STRUCTURES):
        # A library of another release would read our structures wrongly.
        if library.catoptra_abi(number) != ctypes.sizeof(structure):
            raise KernelUnavailableError(
                f"{path} belongs to another release, by its {structure.__name__}; "
                "install the server again"
            )
    return library


def choose_instruction_set() -> str:
    """Best instruction set that the processor has, or the one that CATOPTRA_KERNEL names.

    Raises:
        KernelUnavailableError: The processor has not the one that is named.
    """
    available = available_instruction_sets()
    requested = os.environ.get("CATOPTRA_KERNEL") or "off"
    if requested == "off":
        return available[0]
    if requested not in available:
        raise KernelUnavailableError(
            f"CATOPTRA_KERNEL={requested}; this processor has {', '.join(available)}"
        )
    return requested


def available_instruction_sets(cpu_info: Path = _CPU_INFO) -> tuple[str, ...]:
    """Instruction sets of the processor, best first."""
    if platform.machine() in ("aarch64", "arm64"):
        return ("neon",)
    flags = _read_flags(cpu_info)
    return (*(name for name, needed in _REQUIRED_FLAGS.items() if needed <= flags), "sse4.2")


def _read_flags(cpu_info: Path) -> set[str]:
    """Flags of the first processor."""
    try:
        lines = cpu_info.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return set()
    line = next((line for line in lines if line.startswith("flags")), "")
    return set(line.partition(":")[2].split())


def kernel_library_path(instruction_set: str) -> Path:
    """Path of the kernel's library for an instruction set.

    Raises:
        KernelUnavailableError: CATOPTRA_KERNEL=off, or the installation brought no library.
    """
    if os.environ.get("CATOPTRA_KERNEL") == "off":
        raise KernelUnavailableError("CATOPTRA_KERNEL=off; unset it to trace with the kernel")
    path = Path(__file__).parent / LIBRARY_OF_INSTRUCTION_SET[instruction_set]
    if not path.is_file():
        raise KernelUnavailableError(_missing_library(path))
    return path


def _missing_library(path: Path) -> str:
    """Reason that the build left in place of the library, or the plain absence."""
    try:
        reason = (path.parent / REASON_NAME).read_text(encoding="utf-8").strip()
    except OSError:
        return f"{path} does not exist; install catoptra-server again"
    return f"none was built at installation: {reason}"
