"""Which renderer draws, and why: the one place that knows both.

`auto` takes raster where a graphics processor answers and trace where OpenGL is missing or emulated
in software: on two CPU cores, at one sample a pixel, trace is about as fast on a small field and
twice as fast on 60 000 triangles, and exact (tests/cost/questions/which_renderer.py). A renderer's
library is imported only when it is chosen or looked at: a machine without OpenGL never loads
moderngl's.
"""

from __future__ import annotations

from dataclasses import dataclass

from catoptra_protocol.errors import DomainError
from catoptra_server.plan.render_plan import RendererKind
from catoptra_server.render.renderer import Renderer
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh


@dataclass(frozen=True, slots=True, eq=False)
class Choice:
    """A renderer that holds the scene, its kind, and why it was taken, for the log."""

    renderer: Renderer
    kind: RendererKind
    reason: str


def choose_renderer(requested: str, scene: SceneMesh, world: World, *, threads: int = 0) -> Choice:
    """Return the renderer for `auto`, `trace` or `raster`. `threads` is trace's, 0 = all.

    Raster belongs to the calling thread. Raises RendererUnavailableError where raster is asked for
    and cannot run: it names what is missing and the packages to install.
    """
    match requested:
        case "auto":
            return _automatic(scene, world, threads)
        case "trace":
            return _trace(scene, world, threads, "asked for")
        case "raster":
            return _raster(scene, world)
    raise DomainError(f"a renderer is auto, trace or raster, not {requested!r}")


def _trace(scene: SceneMesh, world: World, threads: int, reason: str) -> Choice:
    from catoptra_server.render.trace import TraceRenderer

    return Choice(TraceRenderer(scene, world, threads=threads), RendererKind.TRACE, reason)


def _raster(scene: SceneMesh, world: World) -> Choice:
    from catoptra_server.render.raster import RasterRenderer

    return Choice(RasterRenderer(scene, world), RendererKind.RASTER, "asked for")


def _automatic(scene: SceneMesh, world: World, threads: int) -> Choice:
    from catoptra_server.render.raster import OpenGLMissingError, RasterRenderer, open_device

    try:
        device = open_device()
    except OpenGLMissingError as error:
        return _trace(scene, world, threads, f"no OpenGL: {error.what}")
    if device.is_software:
        found = device.renderer
        device.close()
        reason = f"only software OpenGL ({found}): trace is as fast here, and exact"
        return _trace(scene, world, threads, reason)
    reason = f"OpenGL on a graphics processor ({device.renderer})"
    return Choice(RasterRenderer(scene, world, device=device), RendererKind.RASTER, reason)
