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
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from catoptra_protocol.wire.reports import Greeting
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.mailbox import Mailbox
from catoptra_server.plan.render_plan import plan_from_wish, wished_samples
from catoptra_server.render.choice import choose_renderer
from catoptra_server.render.renderer import View
from catoptra_server.robot.description import RobotDescription
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh, build_scene
from catoptra_server.simulation import Clock, Fleet, FrameWanted, Simulation, Stop
from catoptra_server.transports.tcp_control import serve_control
from catoptra_server.transports.tcp_image import ImageOptions, serve_images

log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line says. Port 0 = any free one; threads 0 = one a processor."""

    robot: Path
    world: Path
    host: str = "127.0.0.1"
    control_port: int = 3000
    image_port: int = 5003
    images: ImageOptions = field(default_factory=ImageOptions)
    renderer: str = "auto"
    threads: int = 0
    clock: Clock = Clock.REALTIME
    seed: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Setup:
    """Everything that was read and checked before a socket opens."""

    robot: RobotDescription
    world: World
    scene: SceneMesh


@dataclass(frozen=True, slots=True)
class Listening:
    """Where the server listens, once it does."""

    host: str
    control_port: int
    image_port: int


def read_setup(robot: Path, world: Path) -> Setup:
    """Return robot, world and scene. Raises ConfigError; keys that mean nothing are logged once."""
    robot_description, robot_file = read_robot(robot)
    world_description, world_file = read_world(world)
    for file in (robot_file, world_file):
        _report_unknown(file)
    return Setup(robot_description, world_description, build_scene(world_description))


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
    setup = await asyncio.to_thread(read_setup, options.robot, options.world)
    simulation_thread = _SimulationThread(setup, options, loop, on_end=stop.set)
    simulation = await simulation_thread.start()
    try:
        await _listen(setup, options, simulation, simulation_thread.mailbox, announce, stop)
    finally:
        await simulation_thread.stop()


async def _listen(
    setup: Setup,
    options: Options,
    simulation: Simulation,
    mailbox: Mailbox,
    announce: Callable[[Listening], None],
    stop: asyncio.Event,
) -> None:
    """Keep both ports open until told to stop."""
    greeting = Greeting("BotDeathMatch", setup.world.name)
    async with (
        serve_control(
            options.host, options.control_port, greeting=greeting, post=simulation.post
        ) as control,
        serve_images(
            options.host, options.image_port, mailbox=mailbox, options=options.images
        ) as images,
    ):
        announce(Listening(options.host, _port(control), _port(images)))
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
        self.mailbox = Mailbox(
            lambda: self._post_frame_wanted(), ahead=options.clock is Clock.REALTIME
        )
        self._thread = threading.Thread(target=self._main, name="simulation")

    def _post_frame_wanted(self) -> None:
        if self._simulation is not None:
            self._simulation.post(FrameWanted())

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
        except (
            Exception
        ) as error:  # the top of a thread: hand it to whoever waits, or end the server
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
            view = self._view(cleanup)
            setup, options = self._setup, self._options
            fleet = Fleet(setup.robot, setup.world, setup.scene, view=view, seed=options.seed)
            simulation = Simulation(fleet, clock=options.clock, put_frame=self.mailbox.put)
            self._loop.call_soon_threadsafe(self._started.set_result, simulation)
            simulation.run()

    def _view(self, cleanup: ExitStack) -> View | None:
        """Return the view of the robot's camera, freed with its renderer; None without one."""
        setup, options = self._setup, self._options
        omni = setup.robot.omni_camera
        if omni is None:
            log.info("the robot has no omnidirectional camera: nothing will be drawn")
            return None
        choice = choose_renderer(
            options.renderer,
            setup.scene,
            setup.world,
            threads=options.threads,
            samples=wished_samples(omni.wish),
        )
        cleanup.callback(choice.renderer.close)
        plan = plan_from_wish(omni.wish, omni.camera, kind=choice.kind, why=choice.reason)
        log.info("%s", choice.renderer.describe())
        log.info("plan: %s", plan)
        view = choice.renderer.prepare(omni.camera, plan)
        cleanup.callback(view.close)
        return view


__all__ = ["Listening", "Options", "Setup", "read_setup", "serve"]
