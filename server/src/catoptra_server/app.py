"""The server as a whole: from options to listening sockets, and to an orderly end.

Three threads: one owns the simulation's clock and robots, one the renderer; the calling thread's
asyncio loop owns all sockets. Mailboxes and event queues connect the threads.
"""

from __future__ import annotations

import asyncio
import gc
import logging
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.dialect import Dialect
from catoptra_protocol.usarsim.reports import Greeting
from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.config.server_file import ServerOptions, ServerSettings, resolve_settings
from catoptra_server.config.tile_memory import require_tiles_fit
from catoptra_server.frames.mailbox import Mailboxes
from catoptra_server.frames.mounted_camera import mounted_camera_state
from catoptra_server.frames.render_thread import RenderThread
from catoptra_server.frames.view_cache import ErrorBoundTable, ViewCache
from catoptra_server.memory_budget import DEFAULT_LIMIT_BYTES, MIB
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.cost_cache import CostCache, default_cache_folder
from catoptra_server.planning.explicit_plan import requested_samples
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.planning.renderer_choice import choose_renderer
from catoptra_server.planning.renderer_pool import RendererPool
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.simulation import ClockMode, Fleet, Simulation, SimulationEvent, StopRequested
from catoptra_server.startup import (
    StartupConfig,
    create_ray_caster,
    load_request_modules,
    read_startup_config,
)
from catoptra_server.transports.connection_budget import fit_connections
from catoptra_server.transports.network_exposure import warn_of_exposure
from catoptra_server.transports.stream.connection_guard import (
    DESCRIPTORS_PER_CONNECTION,
    MAX_CONNECTIONS,
)
from catoptra_server.transports.stream.server_info import build_server_info
from catoptra_server.transports.stream.stream_server import StreamServer, serve_stream
from catoptra_server.transports.tcp_control import serve_control
from catoptra_server.transports.tcp_image import ImageOptions, serve_images
from catoptra_server.transports.tcp_server import ConnectionLimits, TcpServer
from catoptra_server.worker_thread import WorkerThread

log = logging.getLogger(__name__)


STREAM_PORT = 5005


@dataclass(frozen=True, slots=True)
class Options:
    """Options of the server, as the command line states them."""

    robot_files: tuple[Path, ...]
    """Robot files; INIT chooses among the robots of all of them."""
    world_file: Path
    """World file."""
    server_file: Path | None = None
    """File with UDK's sections for the server; overrides those of robot files."""
    server_options: ServerOptions = field(default_factory=ServerOptions)
    """Options that override the same ones of any file."""
    host: str = "127.0.0.1"
    """Address of all ports."""
    stream_port: int | None = None
    """Port of the ZeroMQ stream, 0 = any free one; None = 5005, or any free one if another is 0."""
    dialect: Dialect = Dialect.UT2004
    """Dialect of the control port."""
    renderer: str = "auto"
    """`auto`, `trace` or `raster`."""
    threads: int = 0
    """Threads of the trace renderer; 0 = one per processor."""
    clock: ClockMode = ClockMode.REALTIME
    """Real time, or lockstep with the commands of clients."""
    seed: int = 0
    """Seed of all random numbers."""
    max_error_px: float | None = None
    """Tolerance of every camera, pixels; None = that of the robot's file."""
    budget_ms: float | None = None
    """Time budget of every camera, milliseconds per frame; None = that of the robot's file."""
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


async def serve(
    options: Options, announce: Callable[[ListeningAddress], None], stop: asyncio.Event
) -> None:
    """Serve until an event is set.

    Args:
        options: the options of the server.
        announce: called once with the addresses, when all ports are open.
        stop: ends the server, also while it starts.

    Raises:
        CatoptraError: if the configuration is wrong, no renderer can run, or a thread failed.
        OSError: if a port cannot be opened.
    """
    startup = await asyncio.to_thread(_read_startup_config, options)
    await asyncio.to_thread(load_request_modules)
    server = _ServerProcess(_apply_accuracy_target(startup, options), options, on_failure=stop.set)
    async with server.run():
        await _open_ports(server, announce, stop)


def _read_startup_config(options: Options) -> StartupConfig:
    """Content of the configuration files, all of whose cameras fit into memory."""
    limit_bytes = options.memory_limit_mib * MIB
    startup = read_startup_config(
        options.robot_files, options.world_file, options.server_file, limit_bytes=limit_bytes
    )
    settings = resolve_settings(startup.server_options, options.server_options)
    require_tiles_fit(startup.robots, settings.multi_view, limit_bytes=limit_bytes)
    return startup


async def _open_ports(
    server: _ServerProcess, announce: Callable[[ListeningAddress], None], stop: asyncio.Event
) -> None:
    """Keep all ports open until the stop event is set."""
    host = server.options.host
    await warn_of_exposure(host)
    async with AsyncExitStack() as open_ports:
        control = await open_ports.enter_async_context(_serve_control_port(server))
        image_port = None
        if server.settings.has_images:
            images = await open_ports.enter_async_context(_serve_image_port(server))
            image_port = images.port
        stream = await open_ports.enter_async_context(_serve_stream_port(server))
        # What is loaded now lives as long as the process: a collection that looks at all 65 000
        # objects would stop every thread for 45 ms, two ticks.
        gc.freeze()
        # After the last port: a program that reads the line may connect to any of them at once.
        announce(ListeningAddress(host, control.port, image_port, stream.port))
        await stop.wait()
        log.info("stopping")


# Parts of the process's descriptors for the connections of control port, image port and stream.
_TCP_DESCRIPTOR_SHARE = 0.25
_STREAM_DESCRIPTOR_SHARE = 0.5


def _serve_control_port(server: _ServerProcess) -> AbstractAsyncContextManager[TcpServer]:
    return serve_control(
        server.options.host,
        server.settings.control_port,
        greeting=Greeting("BotDeathMatch", server.startup.world.name),
        dialect=server.options.dialect,
        post=server.simulation.post,
        limits=_make_limits(server.settings, server.settings.max_connections, "control"),
    )


def _serve_image_port(server: _ServerProcess) -> AbstractAsyncContextManager[TcpServer]:
    settings = server.settings
    return serve_images(
        server.options.host,
        settings.image_port,
        mailboxes=server.mailboxes,
        options=ImageOptions(settings.image_type, settings.legacy_images, settings.multi_view),
        limits=_make_limits(settings, settings.max_image_connections, "image"),
    )


def _make_limits(settings: ServerSettings, max_connections: int, name: str) -> ConnectionLimits:
    fitting = fit_connections(max_connections, share=_TCP_DESCRIPTOR_SHARE, name=name)
    return ConnectionLimits(fitting, settings.handshake_timeout_s, settings.idle_timeout_s)


def _serve_stream_port(server: _ServerProcess) -> AbstractAsyncContextManager[StreamServer]:
    startup, options, settings = server.startup, server.options, server.settings
    port = options.stream_port
    # Scripts of USARSim's time know two ports: with --control-port 0 a second server on the machine
    # would still collide at 5005.
    if port is None:
        port = STREAM_PORT if settings.control_port and settings.image_port else 0
    clock = options.clock.value
    return serve_stream(
        options.host,
        port,
        mailboxes=server.mailboxes,
        post=server.simulation.post,
        server_info=build_server_info(
            startup.robots, startup.world, clock=clock, plans=server.plans
        ),
        query_plan=server.render_thread.query_plan,
        limits=_make_stream_limits(settings),
    )


def _make_stream_limits(settings: ServerSettings) -> ConnectionLimits:
    fitting = fit_connections(
        MAX_CONNECTIONS,
        share=_STREAM_DESCRIPTOR_SHARE,
        descriptors_each=DESCRIPTORS_PER_CONNECTION,
        name="stream",
    )
    return ConnectionLimits(fitting, settings.handshake_timeout_s, settings.idle_timeout_s)


class _ServerProcess:
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
        self.plans: dict[str, str] = {}
        self.error_bounds = ErrorBoundTable()
        is_realtime = options.clock is ClockMode.REALTIME
        # Prefetching renders the next frame before a viewer requests one. Not under lockstep, where
        # frames follow from commands alone, so that the same commands give the same bytes.
        self.mailboxes = Mailboxes(self._post, prefetch=is_realtime)
        self.render_thread = render_thread = RenderThread(
            self.mailboxes, retries_at_once=not is_realtime
        )
        self.simulation = Simulation(
            self._create_fleet(),
            clock=options.clock,
            render=render_thread.submit if is_realtime else render_thread.submit_and_wait,
            reject=self.mailboxes.fail,
            frame_skip=self.settings.frame_skip,
        )
        self._workers = (
            WorkerThread(
                "rendering",
                partial(render_thread.run, self._create_view_cache),
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

        The simulation ends first: under lockstep its thread waits for frames of the other one.
        """
        async with AsyncExitStack() as started:
            for worker in self._workers:
                await worker.start()
                started.push_async_callback(worker.stop)
            yield

    def _create_view_cache(self) -> ViewCache | None:
        """Views of the server's cameras, those of each class's omnidirectional camera prepared.

        Runs in the render thread, which owns the OpenGL context. None without any camera.
        """
        startup, options = self.startup, self.options
        if not any(robot.omni_camera or robot.perspective_cameras for robot in startup.robots):
            log.info("no robot has a camera: no renderer is started")
            return None
        omnis = {r.class_name: r.omni_camera for r in startup.robots if r.omni_camera is not None}
        choice = choose_renderer(
            options.renderer,
            startup.scene,
            startup.world,
            threads=options.threads,
            samples=max(
                (requested_samples(omni.render_settings) for omni in omnis.values()), default=0
            ),
        )
        log.info("%s", choice.renderer.describe())
        views = ViewCache(
            RenderPlanner(
                RendererPool(choice, may_replace=options.clock is ClockMode.REALTIME),
                CostCache(default_cache_folder(), startup.scene),
            ),
            SceneSummarizer(startup.scene, startup.world),
            calibration_states=_make_calibration_states(startup),
            error_bounds=self.error_bounds,
        )
        # Prepared at start: calibration takes seconds, in which the first viewer would wait.
        for name, omni in omnis.items():
            spec = OmniCameraSpec(omni.camera, omni.render_settings, omni.effects)
            self.plans[name] = views.prepare(spec)
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


def _apply_accuracy_target(startup: StartupConfig, options: Options) -> StartupConfig:
    """Start-up configuration with the command line's accuracy target for all cameras."""
    robots = []
    for robot in startup.robots:
        omni = robot.omni_camera
        if omni is not None:
            target = omni.render_settings.accuracy_target.with_changes(
                max_error_px=options.max_error_px, budget_ms=options.budget_ms
            )
            omni = replace(
                omni, render_settings=replace(omni.render_settings, accuracy_target=target)
            )
        robots.append(replace(robot, omni_camera=omni))
    return replace(startup, robots=tuple(robots))


# Start poses at which candidate plans are timed; their frames stand for all frames of the world.
_MAX_CALIBRATION_STATES = 4


def _make_calibration_states(startup: StartupConfig) -> tuple[CameraState, ...]:
    """Camera states for calibration: upright at the world's start poses, or at the origin.

    The height is that of the first robot with an omnidirectional camera.
    """
    height_m = next((r.viewpoint_height_m for r in startup.robots if r.omni_camera), 0.0)
    starts = [
        (s.location_m, s.rotation_rad) for s in startup.world.starts[:_MAX_CALIBRATION_STATES]
    ]
    return tuple(
        mounted_camera_state(PlanarPose(x, y, yaw).at_height(height_m), Pose.identity())
        for (x, y, _), (_, _, yaw) in starts or [((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))]
    )
