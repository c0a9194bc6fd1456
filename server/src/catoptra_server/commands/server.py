"""The server as a whole: from options to listening sockets, and to an orderly end.

Three threads: one owns the simulation's clock and robots, one the renderers; the calling thread's
asyncio loop owns all sockets. Mailboxes and event queues connect the threads. Rendering has
niceness 5, so that reports and sockets come first.

**A start loads what the first frame needs**, since loading takes two thirds (the time to the first
frame: `tests/cost/serving.py`). Lenses, mirrors, effects and sensors are loaded where a file names
them (`catoptra_protocol.lazy_table`), when the files are read; so is the reader of mesh files. The
stream, the live page, the second renderer, labels, NumPy's random numbers and, where the image port
sends RAW, OpenCV are loaded in a thread once the ports listen, at the first client of the stream or
after 0.25 s; clients wait in the backlog. No request loads anything: such a request would be slow,
and would fail where connections have taken all descriptors of open files, since an import opens
files. The modules that use these import inside a function, with a reference to this head;
`tests/end_to_end/test_loaded_modules.py` finds a missing one, and counts the modules of a first
frame. To load OpenCV in a thread beside the renderer gained nothing.
"""

from __future__ import annotations

import asyncio
import gc
import hashlib
import importlib
import logging
import threading
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager, suppress
from dataclasses import field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.grammar import Dialect
from catoptra_protocol.usarsim.image_port import ImageType
from catoptra_protocol.usarsim.reports import Greeting
from catoptra_server import __version__
from catoptra_server.config.server_file import (
    ServerOptions,
    ServerSettings,
    require_tiles_fit,
    resolve_settings,
)
from catoptra_server.config.startup import (
    StartupConfig,
    create_ray_caster,
    make_start_states,
    read_startup_config,
)
from catoptra_server.effects import SceneSummary, is_image_effect, widest_gains
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import plan_effects
from catoptra_server.frames.frame import load_opencv
from catoptra_server.frames.frame_plan import ErrorBoundTable
from catoptra_server.frames.mailbox import Mailboxes
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.costs import CostCache
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.render_thread import RenderThread
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import ViewCache
from catoptra_server.render.renderer_kind import AUTO
from catoptra_server.runtime.array_cache import find_cache_folder
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES, MIB
from catoptra_server.runtime.worker_thread import WorkerThread, lower_thread_priority
from catoptra_server.serve.limits import (
    DESCRIPTORS_PER_CONNECTION,
    MAX_PAGE_CONNECTIONS,
    MAX_STREAM_CONNECTIONS,
    LoopShare,
    fit_connections,
)
from catoptra_server.serve.port import (
    ConnectionLimits,
    Listener,
    create_listener,
    wait_for_connection,
    warn_of_exposure,
)
from catoptra_server.serve.tcp_control import serve_control
from catoptra_server.serve.tcp_image import ImageOptions, serve_images
from catoptra_server.serve.tcp_server import TcpServer
from catoptra_server.simulation.events import SimulationEvent, StopRequested
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.loop import ClockMode, Simulation
from catoptra_server.simulation.robot_description import OmniCameraDescription

if TYPE_CHECKING:
    from catoptra_protocol.stream.replies import SetupReply

    # Loaded late: see the head of this module.
    from catoptra_server.serve.stream.replies import StreamContext
    from catoptra_server.serve.web.web_access import WebAccess
    from catoptra_server.serve.web.web_server import WebServer

log = logging.getLogger(__name__)
_STREAM_PORT = 5005
VIEW_PORT = 5080
# A program that waits for the line of the ports has a first frame 0.05 s later, or 0.1 s where
# modules are loaded meanwhile.
_FIRST_FRAME_TIME_S = 0.25
# Rendering uses all processors at times; the threads of reports and sockets, which mostly wait,
# come first. Under all attacks of tests/load at once 4 to 12 % of the reports were over 20 % late
# without.
_RENDER_NICENESS = 5
# What draws comes first: a sixth of its share. At 10 frames took 1.27 times as long, and at 19
# frames without a pause left the rays of a bake no time for half a minute.
_LIGHT_NICENESS = 13
# Parts of the process's descriptors for the connections of control and image port, each, of stream
# and live page.
_TCP_DESCRIPTOR_SHARE = 0.2
_STREAM_DESCRIPTOR_SHARE = 0.5
_VIEW_DESCRIPTOR_SHARE = 0.1
# In the order in which clients may need modules. NumPy imports some parts at their first use:
# `ma` in `unique`. `statistics` is for cameras with a budget.
_MODULES = (
    "catoptra_server.simulation.kernel_support",
    "catoptra_server.serve.stream.peer",
    "statistics",
    "numpy.ma",
    "numpy.polynomial",
    "numpy.random",
    # For the rays of GetLandmarks, of sensors and of labels, of mirror meshes, and of a kernel that
    # cannot be made anew.
    "catoptra_server.render.trace.ray_caster",
    "catoptra_server.render.trace.mirror_mesh_rays",
    "catoptra_server.render.trace.reference.reference_engine",
    "catoptra_server.render.trace.kernel.kernel_engine",
    "catoptra_server.frames.labels.label_renderer",
)
# Files in `setup`: larger ones have no digest, and texts beyond the other limit are left out.
_MAX_DIGESTED_BYTES, _MAX_SETUP_BYTES = 2**26, 2**18
# Image effects by the kernel: for the raster renderer, and for cameras with such effects.
_STAGE_MODULE = "catoptra_server.render.trace.kernel.image"
# The raster renderer, and what moderngl imports with the first context.
_RASTER_MODULES = (
    _STAGE_MODULE,
    *("catoptra_server.render.raster", "glcontext", "glcontext.egl", "ctypes.util"),
)


@dataclass(frozen=True, slots=True)
class Options:
    """Options of the server, as on the command line."""

    robot_files: tuple[Path, ...]
    """Robot files; INIT chooses among the robots of all."""
    world_file: Path
    """World file."""
    server_file: Path | None = None
    """File with UDK's sections for the server; overrides robot files."""
    server_options: ServerOptions = field(default_factory=ServerOptions)
    """Options that override the same ones of any file."""
    host: str = "127.0.0.1"
    """Address of all ports."""
    stream_port: int | None = None
    """Port of the ZeroMQ stream, 0 = any free one; None = 5005, or any free one if another is 0."""
    has_view: bool = True
    """Whether the live page is served."""
    view_port: int | None = None
    """Port of the live page, 0 = any free one; None = 5080, or any free one if 5080 is in use or
    another port is 0."""
    dialect: Dialect = Dialect.UT2004
    """Dialect of the control port."""
    renderer: str = "auto"
    """`auto`, `trace` or `raster`."""
    threads: int = 0
    """Threads of the trace renderer; 0 = one per processor."""
    clock: ClockMode = ClockMode.REALTIME
    """Real time, or lockstep with the commands of clients."""
    is_strict: bool = False
    """Whether unknown keys of all sections of files are errors."""
    seed: int = 0
    """Seed of all random numbers."""
    max_error_px: float | None = None
    """Tolerance of every camera, pixels; None = as in the robot's file."""
    budget_ms: float | None = None
    """Time budget of every camera, milliseconds per frame; None = as in the robot's file."""
    memory_limit_mib: int = DEFAULT_LIMIT_BYTES // MIB
    """Memory that each camera's view may take, and the world's meshes and textures together."""


@dataclass(frozen=True, slots=True)
class ListeningAddress:
    """Address and actual ports of a server that listens."""

    host: str
    """Address of all ports."""
    control_port: int
    """TCP port of the USARSim protocol."""
    image_port: int | None
    """TCP port of the image server; None without one."""
    stream_port: int
    """TCP port of the ZeroMQ stream."""
    view_link: str | None = None
    """Address of the live page for a browser; None without one."""


async def serve(
    options: Options, announce: Callable[[ListeningAddress], None], stop: asyncio.Event
) -> None:
    """Serve until an event is set.

    Args:
        options: the options of the server.
        announce: called once with the addresses, when all ports are open.
        stop: ends the server, also during the start.

    Raises:
        CatoptraError: if the configuration is wrong, no renderer can run, or a thread failed.
        OSError: if a port cannot be opened.
    """
    startup = await asyncio.to_thread(_read_startup_config, options)
    server = ServerThreads(_apply_accuracy_target(startup, options), options, on_failure=stop.set)
    async with server.run():
        await _open_ports(server, announce, stop)


def _read_startup_config(options: Options) -> StartupConfig:
    """Content of the configuration files, all of whose cameras fit into memory."""
    limit_bytes = options.memory_limit_mib * MIB
    startup = read_startup_config(
        options.robot_files,
        options.world_file,
        options.server_file,
        limit_bytes=limit_bytes,
        is_strict=options.is_strict,
        has_first_light=options.clock is ClockMode.REALTIME,
    )
    settings = resolve_settings(startup.server_options, options.server_options)
    require_tiles_fit(startup.robots, settings.multi_view, limit_bytes=limit_bytes)
    return startup


def _apply_accuracy_target(startup: StartupConfig, options: Options) -> StartupConfig:
    """Start-up configuration with the command line's accuracy target for all cameras."""
    robots = []
    for robot in startup.robots:
        omnis = []
        for omni in robot.omni_cameras:
            target = omni.render_settings.accuracy_target.with_changes(
                max_error_px=options.max_error_px, budget_ms=options.budget_ms
            )
            settings = replace(omni.render_settings, accuracy_target=target)
            omnis.append(replace(omni, render_settings=settings))
        robots.append(replace(robot, omni_cameras=tuple(omnis)))
    return replace(startup, robots=tuple(robots))


class ServerThreads:
    """Simulation and rendering, a thread each, and the mailboxes between these and the sockets."""

    def __init__(
        self, startup: StartupConfig, options: Options, *, on_failure: Callable[[], None]
    ) -> None:
        self.startup = startup
        self.options = options
        self.settings: ServerSettings = resolve_settings(
            startup.server_options, options.server_options
        )
        # Render plan of each class's omnidirectional camera, as text; filled by the render thread.
        self.plans: dict[tuple[str, str], str] = {}
        self.error_bounds: ErrorBoundTable = {}
        is_realtime = options.clock is ClockMode.REALTIME
        # Prefetching renders the next frame before a viewer requests one. Not under lockstep, where
        # frames follow from commands alone, so that the same commands give the same bytes.
        fleet = self._create_fleet()
        self.mailboxes = Mailboxes(self._post, prefetch=is_realtime, resolve=fleet.cameras.resolve)
        self.render_thread = render_thread = RenderThread(
            self.mailboxes, is_lockstep=not is_realtime
        )
        self.simulation = Simulation(
            fleet,
            clock=options.clock,
            render=render_thread.submit if is_realtime else render_thread.submit_and_wait,
            reject=self.mailboxes.fail,
            frame_skip=self.settings.frame_skip,
        )
        self._has_to_stop = threading.Event()
        refinement = WorkerThread(
            "light", self._refine_light, stop=self._has_to_stop.set, on_failure=on_failure
        )
        self._workers = (
            *((refinement,) if startup.light and startup.light.refine else ()),
            WorkerThread(
                "rendering",
                self._render,
                stop=render_thread.stop,
                on_failure=on_failure,
            ),
            WorkerThread(
                "simulation",
                self.simulation.run,
                stop=partial(self._post, StopRequested()),
                on_failure=on_failure,
            ),
        )

    def _post(self, event: SimulationEvent) -> None:
        self.simulation.post(event)

    @asynccontextmanager
    async def run(self) -> AsyncIterator[None]:
        """Run both threads for the length of a block.

        The simulation ends first: under lockstep it waits for frames of the other thread.
        """
        async with AsyncExitStack() as started:
            for worker in self._workers:
                await worker.start()
                started.push_async_callback(worker.stop)
            yield

    def _render(self, on_ready: Callable[[], None]) -> None:
        """Main function of the render thread."""
        # Threads that this one starts, such as those of the trace renderer, have its priority.
        lower_thread_priority(_RENDER_NICENESS)
        self.render_thread.run(self._create_view_cache, on_ready)

    def _refine_light(self, on_ready: Callable[[], None]) -> None:
        """Main function of the thread that casts the rays of baked light that are left."""
        lower_thread_priority(_LIGHT_NICENESS)
        on_ready()
        light = self.startup.light
        assert light is not None, "there is light to be refined"
        assert light.refine is not None, "some of it is left to do"
        refined = light.refine(self._has_to_stop.is_set)
        if not self._has_to_stop.is_set():
            self.startup = self.startup.with_light(refined)
            self.render_thread.replace_views(self._create_view_cache)

    def _create_view_cache(self) -> ViewCache | None:
        """Views of the server's cameras, prepared for each class's omnidirectional cameras.

        Runs in the render thread, which owns the OpenGL context. None without any camera.
        """
        startup = self.startup
        if not any(robot.omni_cameras or robot.perspective_cameras for robot in startup.robots):
            log.info("no robot has a camera: no renderer is started")
            return None
        omnis = {
            (robot.class_name, omni.name): omni
            for robot in startup.robots
            for omni in robot.omni_cameras
        }
        summarizer = SceneSummarizer(startup.scene, startup.world)
        # Bounds of the scene and maps of cameras, most of a first frame otherwise: made beside
        # hierarchy and rays, since NumPy works on both without Python's lock.
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix="effects") as pool:
            # An error is not lost: the frame that needs the result fails, too.
            pool.submit(startup.scene.hierarchy)
            pool.submit(lambda: summarizer.max_radiance)
            for omni in omnis.values():
                pool.submit(plan_effects, omni.effects, SceneSummary(1.0), omni.camera)
            return self._prepare_views(omnis, summarizer)

    def _prepare_views(
        self,
        omnis: Mapping[tuple[str, str], OmniCameraDescription],
        summarizer: SceneSummarizer,
    ) -> ViewCache:
        startup, options = self.startup, self.options
        is_realtime = options.clock is ClockMode.REALTIME
        choice = choose_renderer(
            options.renderer,
            startup.scene,
            startup.world,
            threads=options.threads,
            is_reproducible=not is_realtime,
            gains=widest_gains(startup.effect_settings),
        )
        log.info("%s", choice.renderer.describe())
        if _has_image_effects(startup):
            importlib.import_module(_STAGE_MODULE)
        views = ViewCache(
            RenderPlanner(
                RendererPool(
                    choice,
                    may_replace=is_realtime,
                    note=startup.light.stage if startup.light else "",
                ),
                CostCache(find_cache_folder("costs"), startup.scene),
            ),
            summarizer,
            calibration_states=make_start_states(startup),
            error_bounds=self.error_bounds,
            ends_measures=is_realtime,
        )
        # Prepared at start: calibration takes seconds, in which the first viewer would wait.
        for key, omni in omnis.items():
            spec = OmniCameraSpec(omni.camera, omni.render_settings, omni.effects)
            self.plans[key] = views.prepare(spec)
        return views

    def _create_fleet(self) -> Fleet:
        startup = self.startup
        return Fleet(
            startup.robots,
            startup.world,
            startup.scene,
            seed=self.options.seed,
            ray_caster=create_ray_caster(startup),
            multi_view=self.settings.multi_view,
            error_bound_of=self.error_bounds.get,
        )


def _has_image_effects(startup: StartupConfig) -> bool:
    """Whether any robot's file gives a camera an effect of the image."""
    settings = startup.effect_settings
    return any(is_image_effect(one.effect) for each in settings for one in each.settings)


async def _open_ports(
    server: ServerThreads, announce: Callable[[ListeningAddress], None], stop: asyncio.Event
) -> None:
    """Keep all ports open until the stop event is set."""
    host = server.options.host
    await warn_of_exposure(host)
    limits = _make_limits(server.settings)
    async with AsyncExitStack() as open_ports:
        control = await open_ports.enter_async_context(_serve_control_port(server, limits.control))
        image_port = None
        if server.settings.has_images:
            images = await open_ports.enter_async_context(_serve_image_port(server, limits.image))
            image_port = images.port
        stream = open_ports.enter_context(_create_stream_listener(server))
        view = _create_view_listener(server)
        access = None
        if view is not None:
            from catoptra_server.serve.web.web_access import create_web_access

            open_ports.enter_context(view)
            access = create_web_access(host, view)
        # What is loaded now lives as long as the process: a collection that looks at all 65 000
        # objects would stop every thread for 45 ms, two ticks.
        gc.freeze()
        # Off since the first import, in `__main__`.
        gc.enable()
        # After the last port: a program that reads the line may connect to any at once.
        stream_port = stream.getsockname()[1]
        link = access.link if access is not None else None
        announce(ListeningAddress(host, control.port, image_port, stream_port, link))
        # Clients of stream and page wait in their backlogs meanwhile, as for the line.
        await _wait_for_first_frame([stream, *([view] if view else [])], stop)
        if not stop.is_set():
            await asyncio.to_thread(load_deferred_modules, server.options.renderer)
            # Imported here, as in `_serve_view`: see the head of this module.
            from catoptra_server.serve.stream.peer import serve_stream

            context = _create_stream_context(server)
            await open_ports.enter_async_context(
                serve_stream(stream, context, limits=limits.stream)
            )
            if view is not None and access is not None and await _load_view(view, stop):
                await open_ports.enter_async_context(
                    _serve_view(server, context, view, access, limits.view)
                )
            # Those modules, too.
            gc.freeze()
        await stop.wait()
        log.info("stopping")


async def _wait_for_first_frame(listeners: Sequence[Listener], stop: asyncio.Event) -> None:
    """Wait while a first frame may be under way: not where a client of these ports needs it first,
    nor where the server ends.
    """
    events = [*map(wait_for_connection, listeners), stop.wait()]
    waits = [asyncio.ensure_future(event) for event in events]
    await asyncio.wait(waits, timeout=_FIRST_FRAME_TIME_S, return_when=asyncio.FIRST_COMPLETED)
    for wait in waits:
        wait.cancel()
    await asyncio.gather(*waits, return_exceptions=True)


def load_deferred_modules(renderer: str) -> None:
    """Load all modules that a request may need.

    Args:
        renderer: requested renderer; `auto` may change to another one later.
    """
    load_opencv()
    for name in _MODULES:
        importlib.import_module(name)
    with suppress(ImportError):
        for name in _RASTER_MODULES if renderer == AUTO else ():
            importlib.import_module(name)


def load_view_modules() -> None:
    """Load all modules of the live page: 0.2 s and 13 MB, for which no other port waits."""
    importlib.import_module("catoptra_server.serve.web.web_server")
    importlib.import_module("PIL.ImageDraw")  # for the plan of the map


async def _load_view(view: Listener, stop: asyncio.Event) -> bool:
    """Load the modules of the live page; False if the server ends first or loading fails."""
    loading = asyncio.ensure_future(asyncio.to_thread(load_view_modules))
    stopping = asyncio.ensure_future(stop.wait())
    # A server that ends closes its ports at once, and does not wait for the thread.
    await asyncio.wait((loading, stopping), return_when=asyncio.FIRST_COMPLETED)
    stopping.cancel()
    if not loading.done():
        return False
    try:
        loading.result()
    # OSError: no free descriptor. All else is served without the page.
    except (ImportError, OSError) as error:
        log.error("the live page is not served: %s", error)
        view.close()
        return False
    return True


def _serve_control_port(
    server: ServerThreads, limits: ConnectionLimits
) -> AbstractAsyncContextManager[TcpServer]:
    return serve_control(
        server.options.host,
        server.settings.control_port,
        greeting=Greeting("BotDeathMatch", server.startup.world.name),
        dialect=server.options.dialect,
        post=server.simulation.post,
        limits=limits,
    )


def _serve_image_port(
    server: ServerThreads, limits: ConnectionLimits
) -> AbstractAsyncContextManager[TcpServer]:
    settings = server.settings
    # Of other types the first frame needs it.
    if settings.image_type is not ImageType.RAW:
        load_opencv()
    return serve_images(
        server.options.host,
        settings.image_port,
        mailboxes=server.mailboxes,
        options=ImageOptions(settings.image_type, settings.legacy_images, settings.multi_view),
        limits=limits,
    )


def _create_stream_listener(server: ServerThreads) -> Listener:
    settings, port = server.settings, server.options.stream_port
    # Scripts of USARSim's time know two ports: with --control-port 0 a second server on the machine
    # would still collide at 5005.
    if port is None:
        port = _STREAM_PORT if settings.control_port and settings.image_port else 0
    return create_listener(server.options.host, port, name="stream")


def _create_view_listener(server: ServerThreads) -> Listener | None:
    """Listening socket of the live page; None without one."""
    options, settings = server.options, server.settings
    if not options.has_view:
        return None
    create = partial(create_listener, options.host, name="view")
    if options.view_port is not None:
        return create(options.view_port)
    if not (settings.control_port and settings.image_port and options.stream_port != 0):
        return create(0)
    try:
        return create(VIEW_PORT)
    except OSError as error:
        log.info("the live page takes a free port: %s", error.strerror)
        return create(0)


def _create_stream_context(server: ServerThreads) -> StreamContext:
    """What the stream's clients share, on ZeroMQ and on WebSockets."""
    from catoptra_server.serve.stream.replies import StreamContext, build_server_info

    startup = server.startup
    return StreamContext(
        mailboxes=server.mailboxes,
        post=server.simulation.post,
        server_info=build_server_info(
            startup.robots,
            startup.world,
            clock=server.options.clock.value,
            plans=server.plans,
            setup=_describe_setup(server.options),
        ),
        query_plan=server.render_thread.query_plan,
    )


def _describe_setup(options: Options) -> SetupReply:
    """What it takes to build the same simulation again."""
    from catoptra_protocol.stream.replies import SetupReply
    from catoptra_server.render.trace.kernel.library import (
        KernelUnavailableError,
        choose_instruction_set,
        kernel_library_path,
    )

    files: dict[str, str] = {}
    digests: dict[str, str] = {}
    configured = [] if options.server_file is None else [options.server_file]
    for path in (*options.robot_files, options.world_file, *configured):
        # A file may be gone by now; what it said is in use all the same.
        with suppress(OSError):
            if path.stat().st_size > _MAX_DIGESTED_BYTES:
                continue
            data = path.read_bytes()
            digests[path.name] = hashlib.sha256(data).hexdigest()
            with suppress(UnicodeDecodeError):
                if sum(map(len, files.values())) + len(data) <= _MAX_SETUP_BYTES:
                    files[path.name] = data.decode()
    named = {
        "robot": "\n".join(path.name for path in options.robot_files),
        "world": options.world_file.name,
        "server-ini": options.server_file.name if options.server_file else None,
        "max-error-px": options.max_error_px,
        "budget-ms": options.budget_ms,
        "seed": options.seed,
        "clock": options.clock.value,
        "renderer": options.renderer,
        "dialect": options.dialect.value,
    }
    kernel = ""
    with suppress(KernelUnavailableError, OSError):
        library = kernel_library_path(choose_instruction_set())
        kernel = hashlib.sha256(library.read_bytes()).hexdigest()
    texts = {key: str(value) for key, value in named.items() if value is not None}
    return SetupReply(
        0, files, digests, {**texts, "server": f"Catoptra {__version__}", "kernel": kernel}
    )


def _serve_view(
    server: ServerThreads,
    context: StreamContext,
    listener: Listener,
    access: WebAccess,
    limits: ConnectionLimits,
) -> AbstractAsyncContextManager[WebServer]:
    from catoptra_server.serve.web.pages import WebPages, read_page_files
    from catoptra_server.serve.web.web_server import serve_web

    pages = WebPages(read_page_files(), context.server_info, server.startup.scene)
    return serve_web(listener, context, pages, access=access, limits=limits)


class _PortLimits(NamedTuple):
    """Limits of the connections to each port."""

    control: ConnectionLimits
    image: ConnectionLimits
    stream: ConnectionLimits
    view: ConnectionLimits


def _make_limits(settings: ServerSettings) -> _PortLimits:
    limits = ConnectionLimits(
        max_per_address=settings.max_per_address,
        handshake_timeout_s=settings.handshake_timeout_s,
        idle_timeout_s=settings.idle_timeout_s,
        loop_share=LoopShare(),
    )
    fit_tcp = partial(fit_connections, share=_TCP_DESCRIPTOR_SHARE)
    stream = fit_connections(
        MAX_STREAM_CONNECTIONS,
        share=_STREAM_DESCRIPTOR_SHARE,
        descriptors_each=DESCRIPTORS_PER_CONNECTION,
        name="stream",
    )
    view = fit_connections(MAX_PAGE_CONNECTIONS, share=_VIEW_DESCRIPTOR_SHARE, name="view")
    return _PortLimits(
        replace(limits, max_connections=fit_tcp(settings.max_connections, name="control")),
        replace(limits, max_connections=fit_tcp(settings.max_image_connections, name="image")),
        replace(limits, max_connections=stream),
        replace(limits, max_connections=view),
    )
