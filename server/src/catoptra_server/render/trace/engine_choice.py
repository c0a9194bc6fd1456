"""The engine of the trace renderer: the native kernel where it can run, else the reference."""

from __future__ import annotations

import logging
from typing import Literal

from catoptra_protocol.errors import DomainError
from catoptra_server.render.trace.kernel.library_files import KernelUnavailableError
from catoptra_server.render.trace.trace_engine import TraceEngine
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import Light, World

EngineName = Literal["kernel", "reference"]
EngineRequest = Literal["auto", "kernel", "reference"]

log = logging.getLogger(__name__)


def create_engine(
    request: EngineRequest,
    scene: SceneMesh,
    world: World,
    *,
    threads: int,
    scene_lights: tuple[Light, ...],
    instruction_set: str,
) -> tuple[EngineName, TraceEngine]:
    """Create an engine, and name it.

    Args:
        request: Engine; "auto" takes the kernel and falls back on the reference, with a warning.
        scene: Triangles of the static scene.
        world: Lights of dynamic objects, and background.
        threads: Threads, at least one.
        scene_lights: Lights of the static scene.
        instruction_set: Instruction set of the kernel; "auto" for the processor's best.

    Raises:
        KernelUnavailableError: The kernel was requested and cannot run.
    """

    def create_kernel() -> TraceEngine:
        from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine

        return KernelEngine(
            scene,
            world,
            threads=threads,
            scene_lights=scene_lights,
            instruction_set=instruction_set,
        )

    if request not in ("auto", "kernel", "reference"):
        raise DomainError(f"an engine is auto, kernel or reference, not {request!r}")
    if request == "kernel":
        return "kernel", create_kernel()
    if request == "auto":
        try:
            return "kernel", create_kernel()
        except KernelUnavailableError as error:
            # The message names the missing part and the remedy.
            log.warning("%s; tracing with the NumPy reference, many times slower", error)
    # As above, where the engine is needed: see deferred_modules.
    from catoptra_server.render.trace.reference.reference_engine import ReferenceEngine

    return "reference", ReferenceEngine(scene, world, threads=threads, scene_lights=scene_lights)
