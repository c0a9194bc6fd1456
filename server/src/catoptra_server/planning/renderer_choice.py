"""Choice of a renderer, with its reason: the one module that creates renderers.

`auto` takes raster where a graphics processor answers; else the rule of `renderer_rule` decides
between trace and software OpenGL, by scene, camera, samples and effects. Where bytes must not
depend on the machine the rule decides alone. A renderer's library is imported only when that
renderer is chosen or probed, so a machine without OpenGL runs trace.

To add a renderer: a member of `RendererKind`, a function here, its settings in `candidate_plans`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import field
from functools import partial
from glob import iglob
from typing import TYPE_CHECKING

from catoptra_protocol.errors import DomainError, RendererUnavailableError
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.bounds.light_culling import cull_lights
from catoptra_server.planning.effect_rates import RenderEngine
from catoptra_server.planning.renderer_rule import ImageLoad, RendererRule, SceneLoad
from catoptra_server.processor_count import count_processors
from catoptra_server.render.embreex_package import (
    PACKAGE,
    REMEDY,
    has_embreex,
    require_embreex,
)
from catoptra_server.render.image_changer import ImageChanger, NumpyImageChanger
from catoptra_server.render.renderer import Renderer
from catoptra_server.render.renderer_kind import AUTO, RENDERER_NAMES, RendererKind
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.world_description import Light, World

if TYPE_CHECKING:  # loaded with the renderer that is chosen or probed
    from catoptra_server.render.raster.gl_device import GlDevice
    from catoptra_server.render.trace import TraceRenderer

log = logging.getLogger(__name__)

# Without any of these files EGL finds no graphics processor: Linux drivers, NVIDIA's own, WSL 2,
# Mali, Adreno. Loading OpenGL to find that out takes 0.1 s of every start.
_GPU_FILES = ("/dev/dri/renderD*", "/dev/nvidia[0-9]*", "/dev/dxg", "/dev/mali*", "/dev/kgsl*")

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
    rule: RendererRule | None = None
    """Rule that frames measured on this machine may overrule; None where the choice is final."""
    tracer: _Factory | None = None
    """Factory of the renderer whose rays label frames, whichever draws them."""


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """Arguments of every renderer."""

    mesh: SceneMesh
    world: World
    lights: tuple[Light, ...]
    """Lights of the static scene that are not culled: one decision for all renderers."""
    threads: int
    instruction_set: str = AUTO

    @property
    def load(self) -> SceneLoad:
        """Properties that frame times grow with."""
        return SceneLoad.from_scene(self.mesh, self.lights)


def choose_renderer(
    requested: str,
    scene: SceneMesh,
    world: World,
    *,
    threads: int = 0,
    image: ImageLoad = ImageLoad(),  # noqa: B008 - frozen
    instruction_set: str = AUTO,
    is_reproducible: bool = False,
) -> RendererChoice:
    """Create the renderer for `auto`, `trace` or `raster`.

    Args:
        threads: Threads of trace; 0: one for each processor.
        image: Largest image that will be rendered; `auto` weighs its pixels, samples and effects.
        instruction_set: Instruction set of trace's kernel.
        is_reproducible: Let `auto` follow scene, camera, samples and effects alone, for bytes that
            depend on no machine: under lockstep, in data sets and in studies.

    Returns:
        The choice. Raster belongs to the calling thread.

    Raises:
        RendererUnavailableError: The requested renderer cannot run, or none can; the text names
            the missing library and the packages to install.
    """
    if requested not in RENDERER_NAMES:
        *others, last = RENDERER_NAMES
        raise DomainError(f"a renderer is {', '.join(others)} or {last}, not {requested!r}")
    inputs = _Scene(scene, world, cull_lights(scene, world.lights), threads, instruction_set)
    if requested == AUTO:
        choose = _choose_by_rule_alone if is_reproducible else _choose_for_machine
        return choose(inputs, image)
    kind = RendererKind(requested)
    factory = partial(RENDERER_FACTORIES[kind], inputs)
    return RendererChoice(
        factory(), kind, "requested", factory=factory, tracer=partial(_create_trace, inputs)
    )


def create_renderer(
    kind: RendererKind, scene: SceneMesh, world: World, *, threads: int = 0
) -> Renderer:
    """Create a renderer of one kind, with the lights that the server would give it."""
    return RENDERER_FACTORIES[kind](_Scene(scene, world, cull_lights(scene, world.lights), threads))


def _create_trace(inputs: _Scene) -> TraceRenderer:
    # Before the engines, which would report a missing kernel first.
    require_embreex("the trace renderer", alternative="start with --renderer raster")
    from catoptra_server.render.trace import TraceRenderer

    return TraceRenderer(
        inputs.mesh,
        inputs.world,
        threads=inputs.threads,
        scene_lights=inputs.lights,
        instruction_set=inputs.instruction_set,
    )


def _create_raster(inputs: _Scene, device: GlDevice | None = None) -> Renderer:
    from catoptra_server.render.raster import RasterRenderer, open_device

    return RasterRenderer(
        inputs.mesh,
        inputs.world,
        device=device or open_device(),
        scene_lights=inputs.lights,
        image_changer=open_image_changer(inputs.threads, inputs.instruction_set),
    )


def open_image_changer(threads: int = 0, instruction_set: str = AUTO) -> ImageChanger:
    """Image changer for raster: the kernel's, else NumPy's with a warning.

    Args:
        threads: Threads of the kernel; 0: one for each processor.
        instruction_set: Instruction set of the kernel.
    """
    # Loaded where it is needed: raster serves without the kernel, and without Embree.
    from catoptra_server.render.trace.kernel import kernel_image_changer
    from catoptra_server.render.trace.kernel.library_files import KernelUnavailableError

    try:
        return kernel_image_changer.open_image_changer(
            threads or count_processors(), instruction_set
        )
    except KernelUnavailableError as error:
        log.warning("%s; image effects in NumPy, many times slower", error)
        return NumpyImageChanger()


RENDERER_FACTORIES: Mapping[RendererKind, Callable[[_Scene], Renderer]] = {
    RendererKind.TRACE: _create_trace,
    RendererKind.RASTER: _create_raster,
}


def _choose_by_rule_alone(inputs: _Scene, image: ImageLoad) -> RendererChoice:
    """Choice by scene and camera; trace where it would be an OpenGL that is missing."""
    # Whatever this machine has: the rates of the kernel and of software OpenGL.
    rule = _make_rule(inputs, RenderEngine.KERNEL)
    reason = f"by scene, camera and effects alone: {rule.explain(image)}"
    if not has_embreex():
        return _raster_choice_without_trace(inputs)
    if rule.find_fastest(image) is RendererKind.TRACE:
        return _trace_choice(inputs, reason)
    try:
        return _raster_choice(inputs, reason)
    except RendererUnavailableError as error:
        return _trace_choice(inputs, f"{reason}; {error}")


def _choose_for_machine(inputs: _Scene, image: ImageLoad) -> RendererChoice:
    """Choice for the first frames on this machine, which measured frames may overrule."""
    device = _open_graphics_processor()
    if device is not None:
        reason = f"OpenGL on a graphics processor ({device.renderer})"
        # The rule has no rates of a graphics processor.
        rule = RendererRule(inputs.load, {RendererKind.TRACE: RenderEngine.KERNEL})
        return _raster_choice(inputs, reason, rule=rule, device=device)
    if not has_embreex():
        return _raster_choice_without_trace(inputs)
    trace = _create_trace(inputs)
    rule = _make_rule(inputs, RenderEngine(trace.engine_name))
    reason = f"no graphics processor, by rule {rule.explain(image)}"
    if rule.find_fastest(image) is RendererKind.TRACE:
        return _trace_choice(inputs, reason, rule=rule, renderer=trace)
    try:
        choice = _raster_choice(inputs, reason, rule=rule)
    except RendererUnavailableError as error:
        return _trace_choice(inputs, str(error), renderer=trace)
    trace.close()
    return choice


def _raster_choice_without_trace(inputs: _Scene) -> RendererChoice:
    """Raster, where the package of trace is missing."""
    reason = f"the package {PACKAGE}, which trace needs, is not installed"
    factory = partial(_create_raster, inputs)
    try:
        renderer = factory()
    except RendererUnavailableError as error:
        raise RendererUnavailableError(
            f"no renderer can run. Raster: {error}. Trace: {reason}: {REMEDY}"
        ) from error
    # Its error says what to install.
    tracer = partial(_create_trace, inputs)
    return RendererChoice(renderer, RendererKind.RASTER, reason, factory=factory, tracer=tracer)


def _make_rule(inputs: _Scene, trace: RenderEngine) -> RendererRule:
    """Rule between an engine of trace and software OpenGL."""
    engines = {RendererKind.TRACE: trace, RendererKind.RASTER: RenderEngine.SOFTWARE_OPENGL}
    return RendererRule(inputs.load, engines)


def _open_graphics_processor() -> GlDevice | None:
    """OpenGL device on a graphics processor; None where there is none."""
    if not any(next(iglob(pattern), None) for pattern in _GPU_FILES):
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


def _trace_choice(
    inputs: _Scene,
    reason: str,
    *,
    rule: RendererRule | None = None,
    renderer: Renderer | None = None,
) -> RendererChoice:
    factory = partial(_create_trace, inputs)
    others = {RendererKind.RASTER: partial(_create_raster, inputs)}
    return RendererChoice(
        renderer or factory(), RendererKind.TRACE, reason, others, factory, rule, factory
    )


def _raster_choice(
    inputs: _Scene,
    reason: str,
    *,
    rule: RendererRule | None = None,
    device: GlDevice | None = None,
) -> RendererChoice:
    others = {RendererKind.TRACE: partial(_create_trace, inputs)}
    return RendererChoice(
        _create_raster(inputs, device),
        RendererKind.RASTER,
        reason,
        others,
        partial(_create_raster, inputs),
        rule,
        partial(_create_trace, inputs),
    )
