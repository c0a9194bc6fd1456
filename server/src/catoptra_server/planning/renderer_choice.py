"""Choice of a renderer, with its reason: the one module that creates renderers.

`auto` takes raster where a graphics processor answers and trace where there is no OpenGL. With
OpenGL emulated in software the scene decides: the cost of trace grows with the samples a pixel, the
cost of raster with the triangles. A renderer's library is imported only when that renderer is
chosen or probed, so a machine without OpenGL runs trace.

To add a renderer: a member of `RendererKind`, a function here, its settings in `candidate_plans`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial

from catoptra_protocol.errors import DomainError
from catoptra_server.bounds.light_culling import cull_lights
from catoptra_server.render.renderer import Renderer
from catoptra_server.render.renderer_kind import AUTO, RENDERER_NAMES, RendererKind
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.world_description import Light, World

# Used without an accuracy target; with one, both renderers are measured. 640 x 640 px, ms of both
# cores together (tests/measurements/renderer_comparison.py) for the field, the corridor and 60 000
# triangles of balls: at one sample a pixel trace 11, 15, 9 and raster 21, 30, 26; at 2 x 2 trace
# 27, 40, 14 and raster 32, 41, 37; at 3 x 3 trace 53, 78, 23 and raster 46, 56, 51. So raster is
# faster with many samples and few triangles.
MIN_SOFTWARE_RASTER_SAMPLES = 3
MAX_SOFTWARE_RASTER_TRIANGLES = 20_000

_Factory = Callable[[], Renderer]


@dataclass(frozen=True, slots=True, eq=False)
class RendererChoice:
    """A renderer that holds the scene, and the reason for its choice."""

    renderer: Renderer
    kind: RendererKind
    reason: str
    alternatives: Mapping[RendererKind, _Factory] = field(default_factory=dict)
    """Factories of the other renderers, to be called in the thread of the first one; empty for a
    renderer requested by name."""
    factory: _Factory | None = None
    """Factory of the renderer itself, for one that failed; None: it cannot be made anew."""


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """Arguments of every renderer."""

    mesh: SceneMesh
    world: World
    lights: tuple[Light, ...]
    """Lights of the static scene that are not culled: one decision for all renderers."""
    threads: int


def choose_renderer(
    requested: str, scene: SceneMesh, world: World, *, threads: int = 0, samples: int = 1
) -> RendererChoice:
    """Create the renderer for `auto`, `trace` or `raster`.

    Args:
        threads: Threads of trace; 0: one for each processor.
        samples: Samples along a pixel's side that frames will have; `auto` weighs them.

    Returns:
        The choice. Raster belongs to the calling thread.

    Raises:
        RendererUnavailableError: Raster was requested and cannot run; the text names the missing
            library and the packages to install.
    """
    if requested not in RENDERER_NAMES:
        *others, last = RENDERER_NAMES
        raise DomainError(f"a renderer is {', '.join(others)} or {last}, not {requested!r}")
    inputs = _Scene(scene, world, cull_lights(scene, world.lights), threads)
    if requested == AUTO:
        return _choose_automatically(inputs, samples)
    kind = RendererKind(requested)
    factory = partial(RENDERER_FACTORIES[kind], inputs)
    return RendererChoice(factory(), kind, "requested", factory=factory)


def create_renderer(
    kind: RendererKind, scene: SceneMesh, world: World, *, threads: int = 0
) -> Renderer:
    """Create a renderer of one kind, with the lights that the server would give it."""
    return RENDERER_FACTORIES[kind](_Scene(scene, world, cull_lights(scene, world.lights), threads))


def _create_trace(inputs: _Scene) -> Renderer:
    from catoptra_server.render.trace import TraceRenderer

    return TraceRenderer(
        inputs.mesh, inputs.world, threads=inputs.threads, scene_lights=inputs.lights
    )


def _create_raster(inputs: _Scene) -> Renderer:
    from catoptra_server.render.raster import RasterRenderer

    return RasterRenderer(inputs.mesh, inputs.world, scene_lights=inputs.lights)


RENDERER_FACTORIES: Mapping[RendererKind, Callable[[_Scene], Renderer]] = {
    RendererKind.TRACE: _create_trace,
    RendererKind.RASTER: _create_raster,
}


def _choose_automatically(inputs: _Scene, samples: int) -> RendererChoice:
    from catoptra_server.render.raster import OpenGLMissingError, RasterRenderer, open_device

    def trace(reason: str, alternatives: Mapping[RendererKind, _Factory]) -> RendererChoice:
        factory = partial(_create_trace, inputs)
        return RendererChoice(factory(), RendererKind.TRACE, reason, alternatives, factory)

    try:
        device = open_device()
    except OpenGLMissingError as error:
        return trace(f"no OpenGL: {error.reason}", {})
    reason = f"OpenGL on a graphics processor ({device.renderer})"
    if device.is_software:
        triangles = len(inputs.mesh)
        shape = f"{samples} x {samples} samples of {triangles} triangles"
        reason = f"only software OpenGL ({device.renderer}), for {shape} "
        if samples < MIN_SOFTWARE_RASTER_SAMPLES or triangles > MAX_SOFTWARE_RASTER_TRIANGLES:
            # Closed now: few servers ever need the alternative, which opens a device of its own.
            device.close()
            raster = {RendererKind.RASTER: partial(_create_raster, inputs)}
            return trace(f"{reason}slower than trace", raster)
        reason = f"{reason}faster than trace"
    renderer = RasterRenderer(inputs.mesh, inputs.world, device=device, scene_lights=inputs.lights)
    others = {RendererKind.TRACE: partial(_create_trace, inputs)}
    return RendererChoice(
        renderer, RendererKind.RASTER, reason, others, factory=partial(_create_raster, inputs)
    )
