"""The application: from two files and some options to listening sockets, and to a clean end.

One thread owns the renderer and the simulation clock; this thread's asyncio loop owns all sockets.
The renderer is made in the simulation's thread, because an OpenGL context belongs to the thread
that made it.
"""

from __future__ import annotations

import asyncio
import logging
import signal
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from catoptra_protocol.wire.dialect import Dialect
from catoptra_protocol.wire.reports import Greeting
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.robot_file import read_robots
from catoptra_server.config.world_file import read_world
from catoptra_server.mailbox import Mailbox
from catoptra_server.plan.render_plan import plan_from_wish, wished_samples
from catoptra_server.render.choice import choose_renderer
from catoptra_server.render.renderer import View
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
from catoptra_server.simulation import Clock, Fleet, FrameWanted, Simulation, Stop
from catoptra_server.transports.tcp_control import serve_control
from catoptra_server.transports.tcp_image import ImageOptions, serve_images
from catoptra_server.transports.zmq_stream import serve_stream
from catoptra_server.transports.zmq_stream_facts import facts_of

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

    Raises CatoptraError or OSError if it cannot start, and what ended the simulation if that did.
    """
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    setup = await asyncio.to_thread(read_setup, options.robots, options.world)
    simulation_thread = _SimulationThread(setup, options, loop, on_end=stop.set)
    simulation = await simulation_thread.start()
    try:
        await _listen(setup, options, simulation, simulation_thread, announce, stop)
    finally:
        await simulation_thread.stop()


async def _listen(
    setup: Setup,
    options: Options,
    simulation: Simulation,
    thread: _SimulationThread,
    announce: Callable[[Listening], None],
    stop: asyncio.Event,
) -> None:
    """Keep all ports open until told to stop."""
    greeting = Greeting("BotDeathMatch", setup.world.name)
    async with (
        serve_control(
            options.host,
            options.control_port,
            greeting=greeting,
            dialect=options.dialect,
            post=simulation.post,
        ) as control,
        serve_images(
            options.host, options.image_port, mailbox=thread.mailbox, options=options.images
        ) as images,
        serve_stream(
            options.host,
            options.stream_port,
            mailbox=thread.mailbox,
            post=simulation.post,
            facts=facts_of(
                setup.robots, setup.world, clock=options.clock.value, plans=thread.plans
            ),
        ) as stream,
    ):
        announce(Listening(options.host, _port(control), _port(images), stream.port))
        await stop.wait()
        log.info("stopping")


def _port(server: asyncio.Server) -> int:
    port: int = server.sockets[0].getsockname()[1]
    return port


class _SimulationThread:
    """The thread that owns renderer and simulation, from the making of both to their end."""

    def __init__(
        self,
        setup: Setup,
        options: Options,
        loop: asyncio.AbstractEventLoop,
        *,
        on_end: Callable[[], None],
    ) -> None:
        self._setup = setup
        self._options = options
        self._loop = loop
        self._on_end = on_end
        self._started: asyncio.Future[Simulation] = loop.create_future()
        self._simulation: Simulation | None = None
        self._error: Exception | None = None
        self.plans: dict[str, str] = {}
        self.mailbox = Mailbox(self._post_frame_wanted, ahead=options.clock is Clock.REALTIME)
        self._thread = threading.Thread(target=self._main, name="simulation")

    def _post_frame_wanted(self, newer_than: int) -> None:
        if self._simulation is not None:
            self._simulation.post(FrameWanted(newer_than))

    async def start(self) -> Simulation:
        """Start the thread; return once the renderer is ready, or raise why it is not."""
        self._thread.start()
        try:
            self._simulation = await self._started
        except BaseException:
            self._thread.join()
            raise
        return self._simulation

    async def stop(self) -> None:
        """End the simulation and wait for its thread; raise what ended it, if it was not this."""
        if self._simulation is not None:
            self._simulation.post(Stop())
        await asyncio.to_thread(self._thread.join)
        if self._error is not None:
            raise self._error

    def _main(self) -> None:
        try:
            self._run()
        # The top of a thread: hand whatever it is to who waits for it, or end the server.
        except Exception as error:
            self._loop.call_soon_threadsafe(self._failed, error)

    def _failed(self, error: Exception) -> None:
        if self._started.done():
            log.critical("the simulation ended: %s", error)
            self._error = error
            self._on_end()
        else:
            self._started.set_exception(error)

    def _run(self) -> None:
        with ExitStack() as cleanup:
            views = self._views(cleanup)
            setup, options = self._setup, self._options
            fleet = Fleet(
                setup.robots,
                setup.world,
                setup.scene,
                views=views,
                seed=options.seed,
                caster=_caster(setup),
            )
            simulation = Simulation(fleet, clock=options.clock, put_frame=self.mailbox.put)
            self._loop.call_soon_threadsafe(self._started.set_result, simulation)
            simulation.run()

    def _views(self, cleanup: ExitStack) -> dict[str, View]:
        """Return the view of each class's omni camera, freed with their one renderer."""
        setup, options = self._setup, self._options
        omnis = {r.class_name: r.omni_camera for r in setup.robots if r.omni_camera is not None}
        if not omnis:
            log.info("no robot has an omnidirectional camera: nothing will be drawn")
            return {}
        choice = choose_renderer(
            options.renderer,
            setup.scene,
            setup.world,
            threads=options.threads,
            samples=max(wished_samples(omni.wish) for omni in omnis.values()),
        )
        cleanup.callback(choice.renderer.close)
        log.info("%s", choice.renderer.describe())
        views = {}
        for name, omni in omnis.items():
            plan = plan_from_wish(omni.wish, omni.camera, kind=choice.kind, why=choice.reason)
            log.info("plan of %s: %s", name, plan)
            self.plans[name] = str(plan)
            views[name] = choice.renderer.prepare(omni.camera, plan)
            cleanup.callback(views[name].close)
        return views


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
