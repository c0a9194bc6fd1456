"""Which renderer draws, and why: the one place that knows both.

`auto` takes raster where a graphics processor answers and trace where there is no OpenGL. Where
OpenGL is emulated in software it depends: the cost of trace grows with the samples a pixel, that of
raster with the triangles. A renderer's library is imported only when it is chosen or looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from catoptra_protocol.errors import DomainError
from catoptra_server.render.render_plan import RendererKind
from catoptra_server.render.renderer import Renderer
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.world_description import World

# Where no dial has both measured. Of 640 x 640 px, in the processors' ms of both cores together
# (tests/measurements/renderer_comparison.py): field, corridor and 60 000 triangles of balls take trace
# 11, 15 and 9 ms at one sample a pixel, raster 21, 30 and 26; at 2 x 2 27, 40 and 14 against 32, 41
# and 37; at 3 x 3 53, 78 and 23 against 46, 56 and 51. So raster wins where samples are many and
# triangles few.
MIN_SOFTWARE_RASTER_SAMPLES = 3
MAX_SOFTWARE_RASTER_TRIANGLES = 20_000


@dataclass(frozen=True, slots=True, eq=False)
class RendererChoice:
    """A renderer that holds the scene, its kind, and why it was taken, for the log.

    others: what else could draw, made when it is called for in the same thread. Empty where one
    was asked for by name.
    """

    renderer: Renderer
    kind: RendererKind
    reason: str
    alternatives: Mapping[RendererKind, Callable[[], Renderer]] = field(default_factory=dict)


def choose_renderer(
    requested: str, scene: SceneMesh, world: World, *, threads: int = 0, samples: int = 1
) -> RendererChoice:
    """Return the renderer for `auto`, `trace` or `raster`.

    threads: trace's, 0 = all. samples: how many the picture will have along a pixel's side; `auto`
    weighs them. Raster belongs to the calling thread. Raises RendererUnavailableError where raster
    is asked for and cannot run: it names what is missing and the packages to install.
    """
    match requested:
        case "auto":
            return _choose_automatically(scene, world, threads, samples)
        case "trace":
            return _create_trace(scene, world, threads, "asked for")
        case "raster":
            return _create_raster(scene, world)
    raise DomainError(f"a renderer is auto, trace or raster, not {requested!r}")


def _create_trace(scene: SceneMesh, world: World, threads: int, reason: str) -> RendererChoice:
    from catoptra_server.render.trace import TraceRenderer

    return RendererChoice(TraceRenderer(scene, world, threads=threads), RendererKind.TRACE, reason)


def _create_raster(scene: SceneMesh, world: World) -> RendererChoice:
    from catoptra_server.render.raster import RasterRenderer

    return RendererChoice(RasterRenderer(scene, world), RendererKind.RASTER, "asked for")


def _choose_automatically(
    scene: SceneMesh, world: World, threads: int, samples: int
) -> RendererChoice:
    from catoptra_server.render.raster import OpenGLMissingError, RasterRenderer, open_device

    def trace(reason: str) -> RendererChoice:
        return _create_trace(scene, world, threads, reason)

    try:
        device = open_device()
    except OpenGLMissingError as error:
        return trace(f"no OpenGL: {error.reason}")
    raster_later = {RendererKind.RASTER: lambda: _create_raster(scene, world).renderer}
    trace_later = {RendererKind.TRACE: lambda: trace("tried").renderer}
    reason = f"OpenGL on a graphics processor ({device.renderer})"
    if device.is_software:
        shape = f"{samples} x {samples} samples of {len(scene)} triangles"
        reason = f"only software OpenGL ({device.renderer}), for {shape} "
        if samples < MIN_SOFTWARE_RASTER_SAMPLES or len(scene) > MAX_SOFTWARE_RASTER_TRIANGLES:
            device.close()
            return replace(trace(f"{reason}slower than trace"), alternatives=raster_later)
        reason = f"{reason}faster than trace"
    renderer = RasterRenderer(scene, world, device=device)
    return RendererChoice(renderer, RendererKind.RASTER, reason, trace_later)
