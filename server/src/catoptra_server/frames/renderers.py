"""Renderers of one scene: chosen with a reason, created on demand, made anew and replaced.

The one module that creates renderers. A renderer's library is imported only when that renderer is
chosen or probed, so a machine without OpenGL runs trace. Which view a renderer draws is decided
elsewhere. Belongs to the thread that made the first renderer: OpenGL contexts are bound to threads.

* `auto` is raster where a graphics processor answers, else trace. On a processor the kernel is
  faster than software OpenGL in 28 of 30 cases, by 1.2 to 20 times, and loses 1.18 and 1.38 times
  with 4 x 4 samples under two lamps (`tests/measurements/renderer_comparison.py`). A rule with
  fitted rates, and trials of both at run time, bought no more than these two cases.
* Under lockstep, in data sets and in studies `auto` is trace: bytes do not depend on the machine.
* Raster has image effects from the kernel, too, by reading the linear image back: less than a
  millisecond on llvmpipe, where the same formulas as shaders took several times as long. Raster has
  never run on a real GPU.

To add a renderer: a member of `RendererKind`, a function here, its settings in
`plan/planner.py`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, cast

from catoptra_protocol.errors import DomainError, RendererUnavailableError
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import UNCHANGED, Gains
from catoptra_server.effects.bounds.light_loss import cull_lights
from catoptra_server.render.image_changer import ImageChanger, NumpyImageChanger
from catoptra_server.render.renderer import Renderer
from catoptra_server.render.renderer_kind import AUTO, RENDERER_NAMES, RendererKind
from catoptra_server.runtime.faults import log_fault
from catoptra_server.runtime.memory import count_processors
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import Light, World

if TYPE_CHECKING:
    from catoptra_server.render.raster.device import GlDevice
    from catoptra_server.render.trace import TraceRenderer

log = logging.getLogger(__name__)

# Without any of these files EGL finds no graphics processor: Linux drivers, NVIDIA's own, WSL 2,
# Mali, Adreno. Loading OpenGL to find that out takes 0.1 s of every start.
_GPU_FILES = ("/dev/dri/renderD*", "/dev/nvidia[0-9]*", "/dev/dxg", "/dev/mali*", "/dev/kgsl*")
_RendererFactory = Callable[[], Renderer]


@dataclass(frozen=True, slots=True, eq=False)
class RendererChoice:
    """A renderer that holds the scene, and the reason for its choice."""

    renderer: Renderer
    kind: RendererKind
    reason: str
    factories: Mapping[RendererKind, _RendererFactory] = field(default_factory=dict)
    """Factories of the renderers that may draw, to be called in the thread of the first one: its
    own, to be made anew, and others in its place; a renderer requested by name has its own alone.
    """
    tracer: _RendererFactory | None = None
    """Factory of the renderer whose rays label frames, whichever draws them."""


def choose_renderer(
    requested: str,
    scene: SceneMesh,
    world: World,
    *,
    threads: int = 0,
    is_reproducible: bool = False,
    gains: Gains = UNCHANGED,
) -> RendererChoice:
    """Create the renderer for `auto`, `trace` or `raster`.

    Args:
        threads: Threads of trace; 0: one for each processor.
        is_reproducible: Let `auto` look for no graphics processor, for bytes that depend on no
            machine: under lockstep, in data sets and in studies.
        gains: Factors from the scene's light to that of any camera's picture, for the culling of
            lights.

    Returns:
        The choice. Raster belongs to the calling thread.

    Raises:
        RendererUnavailableError: The requested renderer cannot run; the text names the missing
            library and the packages to install.
    """
    if requested not in RENDERER_NAMES:
        *others, last = RENDERER_NAMES
        raise DomainError(f"a renderer is {', '.join(others)} or {last}, not {requested!r}")
    inputs = _Scene(scene, world, cull_lights(scene, world.lights, gains), threads)
    factories = {kind: partial(make, inputs) for kind, make in RENDERER_FACTORIES.items()}
    if requested != AUTO:
        kind = RendererKind(requested)
        return _make_choice(kind, "requested", {kind: factories[kind]}, inputs)
    device = None if is_reproducible else _open_graphics_processor()
    if device is not None:
        reason = f"OpenGL on a graphics processor ({device.renderer})"
        renderer = _create_raster(inputs, device)
        return _make_choice(RendererKind.RASTER, reason, factories, inputs, renderer)
    reason = "as the bytes are the same everywhere" if is_reproducible else "no graphics processor"
    return _make_choice(RendererKind.TRACE, reason, factories, inputs)


def create_renderer(
    kind: RendererKind, scene: SceneMesh, world: World, *, threads: int = 0
) -> Renderer:
    """Create a renderer of one kind, with the lights that a server gives."""
    return RENDERER_FACTORIES[kind](_Scene(scene, world, cull_lights(scene, world.lights), threads))


# Faces have texels of their own: rays alone meet the model's exact surfaces.
_TRACING_KIND = next(kind for kind in RendererKind if not kind.uses_faces)


class RendererPool:
    """The chosen renderer of a server and its alternatives."""

    def __init__(self, choice: RendererChoice, *, may_replace: bool = True, note: str = "") -> None:
        """Take over the chosen renderer.

        Args:
            choice: Renderer, with the factories of this one and of the others.
            may_replace: Whether an alternative may replace a renderer that fails; not under
                lockstep, where the same commands give the same bytes.
            note: Of the scene as it is drawn now, for the reason of each plan; empty for none.
        """
        self._note = note
        self._choice = choice
        self._renderers: dict[RendererKind, Renderer] = {choice.kind: choice.renderer}
        self._factories = dict(choice.factories)
        self._may_replace = may_replace
        self.default_kind = choice.kind
        """Kind of the renderer for cameras without an accuracy target."""
        self._replaced: dict[RendererKind, RendererKind] = {}
        self._tracer: Renderer | None = None
        self._paint: tuple[SceneMesh, World] | None = None
        """Looks that a renderer which is made anew has to show."""

    @property
    def reason(self) -> str:
        """Reason of that kind."""
        return ": ".join(filter(None, (self.note, self._choice.reason)))

    def is_usable(self, kind: RendererKind) -> bool:
        """Whether a renderer of a kind exists or can be created, and has not been replaced."""
        return kind not in self._replaced and kind in {*self._renderers, *self._factories}

    @property
    def note(self) -> str:
        """Replacements and the note on the scene in words; empty for none."""
        replaced = (
            f"{other.value} in place of {failed.value}, which failed"
            for failed, other in self._replaced.items()
        )
        return ", ".join(filter(None, (*replaced, self._note)))

    def get(self, kind: RendererKind) -> Renderer:
        """Renderer of a kind, created at the first call and at the first one after `renew`.

        Raises:
            RendererUnavailableError: The renderer cannot run on this machine.
        """
        if kind not in self._renderers:
            self._renderers[kind] = self._factories[kind]()
            log.info("%s", self._renderers[kind].describe())
            if self._paint is not None:
                self.repaint(*self._paint)
        return self._renderers[kind]

    def repaint(self, scene: SceneMesh, world: World) -> None:
        """Show the same triangles in other looks and light, by the one renderer that traces."""
        self._paint = scene, world
        if _TRACING_KIND in self._renderers:
            cast("TraceRenderer", self._renderers[_TRACING_KIND]).repaint(scene, world)

    def get_tracer(self) -> TraceRenderer:
        """Renderer whose rays label frames: the one that draws, or one of its own.

        Raises:
            RendererUnavailableError: No ray can be traced on this machine.
        """
        if _TRACING_KIND in self._renderers:
            return cast("TraceRenderer", self._renderers[_TRACING_KIND])
        if self._tracer is None:
            if self._choice.tracer is None:
                raise RendererUnavailableError("this server has no renderer that traces rays")
            self._tracer = self._choice.tracer()
            log.info("labels by %s", self._tracer.describe())
        return cast("TraceRenderer", self._tracer)

    def describe(self, kind: RendererKind) -> str:
        """Description of a renderer, which is created, with engine and device."""
        return self.get(kind).describe()

    def create_candidates(self, requested: str) -> list[RendererKind]:
        """Create the renderers that an accuracy target chooses from.

        The one requested by name; else the default alone where it traces rays: it is exact, and
        software OpenGL slower. One that cannot be created is no longer an alternative.

        Returns:
            Kinds that may be used.
        """
        named = [kind for kind in RendererKind if kind.value == requested and self.is_usable(kind)]
        own = [] if self.default_kind.uses_faces else [self.default_kind]
        usable = []
        for kind in named or own or RendererKind:
            if not self.is_usable(kind):
                continue
            try:
                self.get(kind)
                usable.append(kind)
            except RendererUnavailableError as error:
                del self._factories[kind]
                log.info("%s is not available: %s", kind.value, error)
        return usable

    def renew(self, kind: RendererKind) -> None:
        """Close a renderer, whose views must be closed before; the next use creates it anew."""
        # Without a factory the old one may still render other views.
        if kind in self._factories and kind in self._renderers:
            _close(self._renderers.pop(kind))

    def find_replacement(self, kind: RendererKind) -> RendererKind | None:
        """Kind that may replace a failed one; None under lockstep or after a choice by name."""
        # A renderer requested by name has no alternatives.
        others = (other for other in self._factories if other not in (kind, *self._replaced))
        return next(others, None) if self._may_replace else None

    def replace(self, kind: RendererKind, other: RendererKind) -> None:
        """Use a renderer of another kind in place of a failed one."""
        self._replaced[kind] = other
        self.default_kind = other if self.default_kind is kind else self.default_kind

    def restore(self, kind: RendererKind) -> None:
        """Undo a replacement."""
        self._replaced.pop(kind)
        if self._choice.kind not in self._replaced:
            self.default_kind = self._choice.kind

    def close(self) -> None:
        """Close all renderers."""
        for renderer in self._renderers.values():
            _close(renderer)
        self._renderers.clear()
        if self._tracer is not None:
            _close(self._tracer)
        self._tracer = None


def open_image_changer(threads: int = 0) -> ImageChanger:
    """Image changer for raster: the kernel's, else NumPy's with a warning.

    Args:
        threads: Threads of the kernel; 0: one for each processor.
    """
    # Loaded where it is needed: raster serves without the kernel.
    from catoptra_server.render.trace.kernel.image import KernelImageChanger
    from catoptra_server.render.trace.kernel.library import KernelUnavailableError

    try:
        return KernelImageChanger.open(threads or count_processors())
    except KernelUnavailableError as error:
        log.warning("%s; image effects in NumPy, many times slower", error)
        return NumpyImageChanger()


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """Arguments of every renderer."""

    mesh: SceneMesh
    world: World
    lights: tuple[Light, ...]
    """Lights of the static scene that are not culled: one decision for all renderers."""
    threads: int


def _make_choice(
    kind: RendererKind,
    reason: str,
    factories: Mapping[RendererKind, _RendererFactory],
    inputs: _Scene,
    renderer: Renderer | None = None,
) -> RendererChoice:
    tracer = partial(_create_trace, inputs)
    return RendererChoice(renderer or factories[kind](), kind, reason, factories, tracer)


def _open_graphics_processor() -> GlDevice | None:
    """OpenGL device on a graphics processor; None where there is none."""
    if not any(next(Path("/").glob(pattern[1:]), None) for pattern in _GPU_FILES):
        return None
    from catoptra_server.render.raster import OpenGLMissingError, open_device

    try:
        device = open_device()
    except OpenGLMissingError as error:
        log.info("no OpenGL although there are files of a graphics processor: %s", error.reason)
        return None
    if not device.is_software:
        return device
    log.info("only software OpenGL (%s)", device.renderer)
    device.close()
    return None


def _create_trace(inputs: _Scene) -> TraceRenderer:
    from catoptra_server.render.trace import TraceRenderer

    return TraceRenderer(
        inputs.mesh,
        inputs.world,
        threads=inputs.threads,
        scene_lights=inputs.lights,
    )


def _create_raster(inputs: _Scene, device: GlDevice | None = None) -> Renderer:
    from catoptra_server.render.raster import RasterRenderer, open_device

    return RasterRenderer(
        inputs.mesh,
        inputs.world,
        device=device or open_device(),
        scene_lights=inputs.lights,
        image_changer=open_image_changer(inputs.threads),
    )


RENDERER_FACTORIES: Mapping[RendererKind, Callable[[_Scene], Renderer]] = {
    RendererKind.TRACE: _create_trace,
    RendererKind.RASTER: _create_raster,
}


def _close(renderer: Renderer) -> None:
    try:
        renderer.close()
    except Exception:
        # A lost device cannot always be closed; the server needs nothing more from there.
        log_fault(log, "a renderer could not be closed")
