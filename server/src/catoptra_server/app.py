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

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.dialect import Dialect
from catoptra_protocol.wire.reports import Greeting
from catoptra_server.config.server_file import Said, ServerSettings, settings_of
from catoptra_server.imaging.drawing import Drawing
from catoptra_server.imaging.planning import Planning
from catoptra_server.imaging.shot import OmniEye
from catoptra_server.imaging.views import Published, Views
from catoptra_server.mailbox import Mailboxes
from catoptra_server.plan.render_plan import wished_samples
from catoptra_server.render.choice import choose_renderer
from catoptra_server.render.cost_cache import CostCache, user_cache
from catoptra_server.render.renderer import Exposure
from catoptra_server.setup import Setup, ray_caster, read_setup
from catoptra_server.simulation import Clock, Fleet, Request, Simulation, Stop
from catoptra_server.transports.tcp_control import serve_control
from catoptra_server.transports.tcp_image import ImageOptions, serve_images
from catoptra_server.transports.zmq_stream import StreamServer, serve_stream
from catoptra_server.transports.zmq_stream_facts import facts_of
from catoptra_server.workers import Worker

log = logging.getLogger(__name__)


STREAM_PORT = 5005


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line says. Port 0 = any free one; threads 0 = one a processor.

    said: what ini files may say, too; here it counts more. stream_port: None = the usual one, or
    any free one where another port is. max_error_px, budget_ms: of every camera; None = as its
    file says.
    """

    robots: tuple[Path, ...]
    world: Path
    server: Path | None = None
    said: Said = field(default_factory=Said)
    host: str = "127.0.0.1"
    stream_port: int | None = None
    dialect: Dialect = Dialect.UT2004
    renderer: str = "auto"
    threads: int = 0
    clock: Clock = Clock.REALTIME
    seed: int = 0
    max_error_px: float | None = None
    budget_ms: float | None = None


@dataclass(frozen=True, slots=True)
class Listening:
    """Where the server listens, once it does. image_port: None if it has none."""

    host: str
    control_port: int
    image_port: int | None
    stream_port: int


async def serve(options: Options, announce: Callable[[Listening], None]) -> None:
    """Serve until SIGINT or SIGTERM.

    Raises CatoptraError or OSError if it cannot start, and what ended one of its threads.
    """
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    setup = await asyncio.to_thread(read_setup, options.robots, options.world, options.server)
    server = _Server(_turned(setup, options), options, on_failure=stop.set)
    async with server.running():
        await _listen(server, announce, stop)


async def _listen(
    server: _Server, announce: Callable[[Listening], None], stop: asyncio.Event
) -> None:
    """Keep all ports open until told to stop."""
    host = server.options.host
    async with AsyncExitStack() as open_ports:
        control = await open_ports.enter_async_context(_control_port(server))
        image_port = None
        if server.settings.has_images:
            image_port = _port(await open_ports.enter_async_context(_image_port(server)))
        stream = await open_ports.enter_async_context(_stream_port(server))
        announce(Listening(host, _port(control), image_port, stream.port))
        await stop.wait()
        log.info("stopping")


def _control_port(server: _Server) -> AbstractAsyncContextManager[asyncio.Server]:
    return serve_control(
        server.options.host,
        server.settings.control_port,
        greeting=Greeting("BotDeathMatch", server.setup.world.name),
        dialect=server.options.dialect,
        post=server.simulation.post,
        most=server.settings.most_controllers,
    )


def _image_port(server: _Server) -> AbstractAsyncContextManager[asyncio.Server]:
    settings = server.settings
    return serve_images(
        server.options.host,
        settings.image_port,
        mailboxes=server.mailboxes,
        options=ImageOptions(settings.image_type, settings.legacy_images, settings.multi_view),
    )


def _stream_port(server: _Server) -> AbstractAsyncContextManager[StreamServer]:
    """Serve at the port asked for; who wants any free port elsewhere wants one here too."""
    setup, options, settings = server.setup, server.options, server.settings
    port = options.stream_port
    if port is None:
        port = STREAM_PORT if settings.control_port and settings.image_port else 0
    clock = options.clock.value
    return serve_stream(
        options.host,
        port,
        mailboxes=server.mailboxes,
        post=server.simulation.post,
        facts=facts_of(setup.robots, setup.world, clock=clock, plans=server.plans),
        plan_of=server.drawing.ask,
    )


def _port(server: asyncio.Server) -> int:
    port: int = server.sockets[0].getsockname()[1]
    return port


class _Server:
    """Simulation and drawing, each in its thread, and the mailboxes between them and the sockets.

    plans: how each class's omnidirectional camera is drawn, by class name; known once it runs.
    """

    def __init__(self, setup: Setup, options: Options, *, on_failure: Callable[[], None]) -> None:
        self.setup = setup
        self.options = options
        self.settings: ServerSettings = settings_of(setup.said, options.said)
        self.plans: dict[str, str] = {}
        self.bounds = Published()
        is_realtime = options.clock is Clock.REALTIME
        self.mailboxes = Mailboxes(self._post, ahead=is_realtime)
        self.drawing = drawing = Drawing(self.mailboxes.put)
        self.simulation = Simulation(
            self._fleet(),
            clock=options.clock,
            draw=drawing.draw if is_realtime else drawing.draw_and_wait,
            refuse=self.mailboxes.refuse,
            frame_skip=self.settings.frame_skip,
        )
        self._workers = (
            Worker(
                "drawing",
                partial(drawing.run, self._views),
                stop=drawing.stop,
                on_failure=on_failure,
            ),
            Worker(
                "simulation",
                self.simulation.run,
                stop=partial(self._post, Stop()),
                on_failure=on_failure,
            ),
        )

    def _post(self, request: Request) -> None:
        self.simulation.post(request)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Run both threads; what waits for pictures ends before who draws them."""
        async with AsyncExitStack() as started:
            for worker in self._workers:
                await worker.start()
                started.push_async_callback(worker.stop)
            yield

    def _views(self) -> Views | None:
        """Return the views of this server, those of each class's omni camera prepared."""
        setup, options = self.setup, self.options
        if not any(robot.omni_camera or robot.cameras for robot in setup.robots):
            log.info("no robot has a camera: nothing will be drawn")
            return None
        omnis = {r.class_name: r.omni_camera for r in setup.robots if r.omni_camera is not None}
        choice = choose_renderer(
            options.renderer,
            setup.scene,
            setup.world,
            threads=options.threads,
            samples=max((wished_samples(omni.wish) for omni in omnis.values()), default=0),
        )
        log.info("%s", choice.renderer.describe())
        views = Views(
            Planning(choice, CostCache(user_cache(), setup.scene)),
            places=_places(setup),
            published=self.bounds,
        )
        for name, omni in omnis.items():
            self.plans[name] = str(views.plan(OmniEye(omni.camera, omni.wish, omni.effects)))
        return views

    def _fleet(self) -> Fleet:
        setup = self.setup
        return Fleet(
            setup.robots,
            setup.world,
            setup.scene,
            seed=self.options.seed,
            caster=ray_caster(setup),
            multi_view=self.settings.multi_view,
            bound_of=self.bounds.bound,
        )


def _turned(setup: Setup, options: Options) -> Setup:
    """Return the setup with the dials of all cameras as the command line says."""
    robots = []
    for robot in setup.robots:
        omni = robot.omni_camera
        if omni is not None:
            dial = omni.wish.dial.turned(
                max_error_px=options.max_error_px, budget_ms=options.budget_ms
            )
            omni = replace(omni, wish=replace(omni.wish, dial=dial))
        robots.append(replace(robot, omni_camera=omni))
    return replace(setup, robots=tuple(robots))


# Frames of a few places stand for all in the measuring of what they cost.
_MOST_PLACES = 4


def _places(setup: Setup) -> tuple[Exposure, ...]:
    """Return what cameras see from the world's starts, upright, at the first one's height."""
    height_m = next((r.viewpoint_height_m for r in setup.robots if r.omni_camera), 0.0)
    starts = [(s.location_m, s.rotation_rad) for s in setup.world.starts[:_MOST_PLACES]]
    return tuple(
        Exposure(Pose.from_rpy((x, y, -height_m), (0.0, 0.0, yaw)))
        for (x, y, _), (_, _, yaw) in starts or [((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))]
    )
