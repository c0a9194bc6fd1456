"""The application: from two files and some options to listening sockets, and to a clean end.

Three threads: one owns the simulation's clock and robots, one the renderer, and this one's asyncio
loop all sockets.
"""

from __future__ import annotations

import asyncio
import logging
import signal
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from catoptra_protocol.wire.dialect import Dialect
from catoptra_protocol.wire.reports import Greeting
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.robot_file import read_robots
from catoptra_server.config.world_file import read_world
from catoptra_server.imaging.drawing import Drawing
from catoptra_server.imaging.shot import OmniEye
from catoptra_server.imaging.views import Views
from catoptra_server.mailbox import Mailboxes
from catoptra_server.plan.render_plan import wished_samples
from catoptra_server.render.choice import choose_renderer
from catoptra_server.robot.description import (
    GpsDescription,
    RangeScannerDescription,
    RobotDescription,
    SonarDescription,
    TouchDescription,
    VictimSensorDescription,
)
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh, build_scene
from catoptra_server.sensors.sight import RayCaster
from catoptra_server.simulation import Clock, Fleet, Request, Simulation, Stop
from catoptra_server.transports.tcp_control import serve_control
from catoptra_server.transports.tcp_image import ImageOptions, serve_images
from catoptra_server.transports.zmq_stream import serve_stream
from catoptra_server.transports.zmq_stream_facts import facts_of
from catoptra_server.workers import Worker

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line says. Port 0 = any free one; threads 0 = one a processor."""

    robots: tuple[Path, ...]
    world: Path
    host: str = "127.0.0.1"
    control_port: int = 3000
    image_port: int = 5003
    stream_port: int = 0
    images: ImageOptions = field(default_factory=ImageOptions)
    dialect: Dialect = Dialect.UT2004
    renderer: str = "auto"
    threads: int = 0
    clock: Clock = Clock.REALTIME
    seed: int = 0
    frame_skip: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class Setup:
    """Everything that was read and checked before a socket opens."""

    robots: tuple[RobotDescription, ...]
    world: World
    scene: SceneMesh


@dataclass(frozen=True, slots=True)
class Listening:
    """Where the server listens, once it does."""

    host: str
    control_port: int
    image_port: int
    stream_port: int


def read_setup(robots: Sequence[Path], world: Path) -> Setup:
    """Return robots, world and scene. Raises ConfigError; unknown keys are logged once."""
    read = [read_robots(robot) for robot in robots]
    world_description, world_file = read_world(world)
    for file in (*(file for _, file in read), world_file):
        _report_unknown(file)
    descriptions = tuple(description for found, _ in read for description in found)
    return Setup(descriptions, world_description, build_scene(world_description))


def _report_unknown(file: IniFile) -> None:
    for entry in file.unknown():
        log.warning("%s: key %s is not known here and has no effect", entry.where, entry.key)


async def serve(options: Options, announce: Callable[[Listening], None]) -> None:
    """Serve until SIGINT or SIGTERM.

    Raises CatoptraError or OSError if it cannot start, and what ended one of its threads.
    """
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    setup = await asyncio.to_thread(read_setup, options.robots, options.world)
    server = _Server(setup, options, on_failure=stop.set)
    async with server.running():
        await _listen(server, announce, stop)


async def _listen(
    server: _Server, announce: Callable[[Listening], None], stop: asyncio.Event
) -> None:
    """Keep all ports open until told to stop."""
    setup, options, mailboxes = server.setup, server.options, server.mailboxes
    post = server.simulation.post
    greeting = Greeting("BotDeathMatch", setup.world.name)
    async with (
        serve_control(
            options.host,
            options.control_port,
            greeting=greeting,
            dialect=options.dialect,
            post=post,
        ) as control,
        serve_images(
            options.host, options.image_port, mailboxes=mailboxes, options=options.images
        ) as images,
        serve_stream(
            options.host,
            options.stream_port,
            mailboxes=mailboxes,
            post=post,
            facts=facts_of(
                setup.robots, setup.world, clock=options.clock.value, plans=server.plans
            ),
        ) as stream,
    ):
        announce(Listening(options.host, _port(control), _port(images), stream.port))
        await stop.wait()
        log.info("stopping")


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
        self.plans: dict[str, str] = {}
        is_realtime = options.clock is Clock.REALTIME
        self.mailboxes = Mailboxes(self._post, ahead=is_realtime)
        drawing = Drawing(self.mailboxes.put)
        self.simulation = Simulation(
            _fleet(setup, options),
            clock=options.clock,
            draw=drawing.draw if is_realtime else drawing.draw_and_wait,
            refuse=self.mailboxes.refuse,
            frame_skip=options.frame_skip,
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
        views = Views(choice.renderer, choice.kind, choice.reason)
        for name, omni in omnis.items():
            self.plans[name] = str(views.plan(OmniEye(omni.camera, omni.wish)))
        return views


def _fleet(setup: Setup, options: Options) -> Fleet:
    return Fleet(
        setup.robots,
        setup.world,
        setup.scene,
        seed=options.seed,
        caster=_caster(setup),
        multi_view=options.images.multi_view,
    )


# What needs rays. A scene that nothing measures is not committed a second time.
_MEASURING = (
    RangeScannerDescription,
    SonarDescription,
    TouchDescription,
    VictimSensorDescription,
    GpsDescription,
)


def _caster(setup: Setup) -> RayCaster | None:
    """Return the scene for sensors that measure it; None if no robot has one."""
    sensors = [sensor for robot in setup.robots for sensor in robot.sensors]
    if not any(isinstance(sensor, _MEASURING) for sensor in sensors):
        return None
    from catoptra_server.render.trace.ray_caster import EmbreeRayCaster

    return EmbreeRayCaster(setup.scene)


__all__ = ["Listening", "Options", "Setup", "read_setup", "serve"]
