"""The application: from two files and some options to listening sockets, and to a clean end.

Three threads: one owns the simulation's clock and robots, one the renderer, and this one's asyncio
loop all sockets.
"""

from __future__ import annotations

import asyncio
import logging
import signal
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
from catoptra_server.frames.mailbox import Mailboxes
from catoptra_server.frames.render_thread import RenderThread
from catoptra_server.frames.view_cache import ErrorBoundTable, ViewCache
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.cost_cache import CostCache, default_cache_folder
from catoptra_server.planning.render_planner import RenderPlanner
from catoptra_server.planning.renderer_choice import choose_renderer
from catoptra_server.render.render_plan import requested_samples
from catoptra_server.simulation import ClockMode, Fleet, Simulation, SimulationEvent, StopRequested
from catoptra_server.startup import StartupConfig, create_ray_caster, read_startup_config
from catoptra_server.transports.stream.server_info import build_server_info
from catoptra_server.transports.stream.stream_server import StreamServer, serve_stream
from catoptra_server.transports.tcp_control import serve_control
from catoptra_server.transports.tcp_image import ImageOptions, serve_images
from catoptra_server.worker_thread import WorkerThread

log = logging.getLogger(__name__)


STREAM_PORT = 5005


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line says. Port 0 = any free one; threads 0 = one a processor.

    said: what ini files may say, too; here it counts more. stream_port: None = the usual one, or
    any free one where another port is. max_error_px, budget_ms: of every camera; None = as its
    file says.
    """

    robot_files: tuple[Path, ...]
    world_file: Path
    server_file: Path | None = None
    server_options: ServerOptions = field(default_factory=ServerOptions)
    host: str = "127.0.0.1"
    stream_port: int | None = None
    dialect: Dialect = Dialect.UT2004
    renderer: str = "auto"
    threads: int = 0
    clock: ClockMode = ClockMode.REALTIME
    seed: int = 0
    max_error_px: float | None = None
    budget_ms: float | None = None


@dataclass(frozen=True, slots=True)
class ListeningAddress:
    """Where the server listens, once it does. image_port: None if it has none."""

    host: str
    control_port: int
    image_port: int | None
    stream_port: int


async def serve(options: Options, announce: Callable[[ListeningAddress], None]) -> None:
    """Serve until SIGINT or SIGTERM.

    Raises CatoptraError or OSError if it cannot start, and what ended one of its threads.
    """
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    setup = await asyncio.to_thread(
        read_startup_config, options.robot_files, options.world_file, options.server_file
    )
    server = _ServerProcess(_apply_accuracy_target(setup, options), options, on_failure=stop.set)
    async with server.run():
        await _open_ports(server, announce, stop)


async def _open_ports(
    server: _ServerProcess, announce: Callable[[ListeningAddress], None], stop: asyncio.Event
) -> None:
    """Keep all ports open until told to stop."""
    host = server.options.host
    async with AsyncExitStack() as open_ports:
        control = await open_ports.enter_async_context(_serve_control_port(server))
        image_port = None
        if server.settings.has_images:
            image_port = _bound_port(
                await open_ports.enter_async_context(_serve_image_port(server))
            )
        stream = await open_ports.enter_async_context(_serve_stream_port(server))
        announce(ListeningAddress(host, _bound_port(control), image_port, stream.port))
        await stop.wait()
        log.info("stopping")


def _serve_control_port(server: _ServerProcess) -> AbstractAsyncContextManager[asyncio.Server]:
    return serve_control(
        server.options.host,
        server.settings.control_port,
        greeting=Greeting("BotDeathMatch", server.startup.world.name),
        dialect=server.options.dialect,
        post=server.simulation.post,
        max_connections=server.settings.max_connections,
    )


def _serve_image_port(server: _ServerProcess) -> AbstractAsyncContextManager[asyncio.Server]:
    settings = server.settings
    return serve_images(
        server.options.host,
        settings.image_port,
        mailboxes=server.mailboxes,
        options=ImageOptions(settings.image_type, settings.legacy_images, settings.multi_view),
    )


def _serve_stream_port(server: _ServerProcess) -> AbstractAsyncContextManager[StreamServer]:
    """Serve at the port asked for; who wants any free port elsewhere wants one here too."""
    setup, options, settings = server.startup, server.options, server.settings
    port = options.stream_port
    if port is None:
        port = STREAM_PORT if settings.control_port and settings.image_port else 0
    clock = options.clock.value
    return serve_stream(
        options.host,
        port,
        mailboxes=server.mailboxes,
        post=server.simulation.post,
        server_info=build_server_info(setup.robots, setup.world, clock=clock, plans=server.plans),
        query_plan=server.render_thread.query_plan,
    )


def _bound_port(server: asyncio.Server) -> int:
    port: int = server.sockets[0].getsockname()[1]
    return port


class _ServerProcess:
    """Simulation and drawing, each in its thread, and the mailboxes between them and the sockets.

    plans: how each class's omnidirectional camera is drawn, by class name; known once it runs.
    """

    def __init__(
        self, startup: StartupConfig, options: Options, *, on_failure: Callable[[], None]
    ) -> None:
        self.startup = startup
        self.options = options
        self.settings: ServerSettings = resolve_settings(
            startup.server_options, options.server_options
        )
        self.plans: dict[str, str] = {}
        self.error_bounds = ErrorBoundTable()
        is_realtime = options.clock is ClockMode.REALTIME
        self.mailboxes = Mailboxes(self._post, prefetch=is_realtime)
        self.render_thread = drawing = RenderThread(self.mailboxes.put)
        self.simulation = Simulation(
            self._create_fleet(),
            clock=options.clock,
            render=drawing.submit if is_realtime else drawing.submit_and_wait,
            reject=self.mailboxes.fail,
            frame_skip=self.settings.frame_skip,
        )
        self._workers = (
            WorkerThread(
                "drawing",
                partial(drawing.run, self._create_view_cache),
                stop=drawing.stop,
                on_failure=on_failure,
            ),
            WorkerThread(
                "simulation",
                self.simulation.run,
                stop=partial(self._post, StopRequested()),
                on_failure=on_failure,
            ),
        )

    def _post(self, request: SimulationEvent) -> None:
        self.simulation.post(request)

    @asynccontextmanager
    async def run(self) -> AsyncIterator[None]:
        """Run both threads; what waits for pictures ends before who draws them."""
        async with AsyncExitStack() as started:
            for worker in self._workers:
                await worker.start()
                started.push_async_callback(worker.stop)
            yield

    def _create_view_cache(self) -> ViewCache | None:
        """Return the views of this server, those of each class's omni camera prepared."""
        setup, options = self.startup, self.options
        if not any(robot.omni_camera or robot.perspective_cameras for robot in setup.robots):
            log.info("no robot has a camera: nothing will be drawn")
            return None
        omnis = {r.class_name: r.omni_camera for r in setup.robots if r.omni_camera is not None}
        choice = choose_renderer(
            options.renderer,
            setup.scene,
            setup.world,
            threads=options.threads,
            samples=max(
                (requested_samples(omni.render_settings) for omni in omnis.values()), default=0
            ),
        )
        log.info("%s", choice.renderer.describe())
        views = ViewCache(
            RenderPlanner(choice, CostCache(default_cache_folder(), setup.scene)),
            SceneSummarizer(setup.scene, setup.world),
            calibration_states=_make_calibration_states(setup),
            error_bounds=self.error_bounds,
        )
        for name, omni in omnis.items():
            self.plans[name] = str(
                views.plan(OmniCameraSpec(omni.camera, omni.render_settings, omni.effects))
            )
        return views

    def _create_fleet(self) -> Fleet:
        setup = self.startup
        return Fleet(
            setup.robots,
            setup.world,
            setup.scene,
            seed=self.options.seed,
            ray_caster=create_ray_caster(setup),
            multi_view=self.settings.multi_view,
            error_bound_of=self.error_bounds.get,
        )


def _apply_accuracy_target(startup: StartupConfig, options: Options) -> StartupConfig:
    """Return the setup with the dials of all cameras as the command line says."""
    robots = []
    for robot in startup.robots:
        omni = robot.omni_camera
        if omni is not None:
            dial = omni.render_settings.accuracy_target.with_changes(
                max_error_px=options.max_error_px, budget_ms=options.budget_ms
            )
            omni = replace(
                omni, render_settings=replace(omni.render_settings, accuracy_target=dial)
            )
        robots.append(replace(robot, omni_camera=omni))
    return replace(startup, robots=tuple(robots))


# Frames of a few places stand for all in the measuring of what they cost.
_MAX_CALIBRATION_STATES = 4


def _make_calibration_states(startup: StartupConfig) -> tuple[CameraState, ...]:
    """Return what cameras see from the world's starts, upright, at the first one's height."""
    height_m = next((r.viewpoint_height_m for r in startup.robots if r.omni_camera), 0.0)
    starts = [
        (s.location_m, s.rotation_rad) for s in startup.world.starts[:_MAX_CALIBRATION_STATES]
    ]
    return tuple(
        CameraState(Pose.from_rpy((x, y, -height_m), (0.0, 0.0, yaw)))
        for (x, y, _), (_, _, yaw) in starts or [((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))]
    )
