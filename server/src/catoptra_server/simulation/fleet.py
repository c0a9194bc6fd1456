"""The robots of all clients: spawning, commands, motion, readings and frames.

The one face of robots, cameras and obstacles to the simulation loop; the robot of a command is
found here, and the command executed in `commands.py`. Knows no clock and no queue.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from typing import assert_never

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.usarsim.commands import (
    Command,
    Drive,
    DriveJoints,
    GetConf,
    GetGeo,
    GetStartPoses,
    Init,
    MisPkg,
    MultiDrive,
    Note,
    SetCommand,
    SetViewports,
    ShareControl,
    StepCommand,
    Stepper,
    Trace,
)
from catoptra_protocol.usarsim.reports import InitResult, Report, StartPoses
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.multi_view import TileLayout
from catoptra_server.runtime.faults import log_fault
from catoptra_server.simulation.collision_index import CollisionIndex
from catoptra_server.simulation.commands import (
    ErrorBoundLookup,
    RemoteControl,
    execute_control,
    execute_get_conf,
    execute_get_geo,
)
from catoptra_server.simulation.drive import RobotBody
from catoptra_server.simulation.events import AccuracyTargetChanged, Client, RejectedError
from catoptra_server.simulation.fleet_cameras import (
    FleetCameras,
    FleetEnvironment,
)
from catoptra_server.simulation.robot import FleetState, Robot, collect_fleet_state
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.simulation.sensors import EmptyScene, RayCaster, SensorEnvironment
from catoptra_server.simulation.spawning import SpawnError, place_robot, unique_name
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import World

log = logging.getLogger(__name__)

# More than any program has spawned; each costs a share of every tick.
_MAX_ROBOTS = 64


class Fleet:
    """The robots of one world, one a client. Only the simulation thread may call methods."""

    def __init__(
        self,
        descriptions: Sequence[RobotDescription],
        world: World,
        scene: SceneMesh,
        *,
        seed: int,
        ray_caster: RayCaster | None = None,
        multi_view: TileLayout | None = None,
        error_bound_of: ErrorBoundLookup = lambda camera: None,
    ) -> None:
        """Create a fleet without robots.

        Args:
            descriptions: Classes that INIT may name.
            world: Start poses, tags, victims, GPS origin and landmarks.
            scene: The world as triangles, for collisions.
            seed: Seed of all random numbers.
            ray_caster: The world as sensors measure it; None for an empty one.
            multi_view: Tiles of the image port; None for the viewports of one robot.
            error_bound_of: Error bound of a camera, reported with CONF.
        """
        self._classes = tuple(descriptions)
        self._world = world
        self._seed = seed
        self._error_bound_of = error_bound_of
        # In the order of spawning, which decides the displayed robot and which robot moves first.
        self._robots: dict[Client, Robot] = {}
        self._num_spawned = 0
        # Clients whose robots raised in the present tick.
        self._faulty: list[Client] = []
        caster = ray_caster or EmptyScene()
        self._collision_index = CollisionIndex(scene, caster)
        self._environment = FleetEnvironment(
            self._robots.values(), world, scene, caster, self._collision_index
        )
        self.cameras = FleetCameras(
            self._robots.values(),
            self._classes,
            self._environment,
            multi_view=multi_view,
            error_bound_of=error_bound_of,
        )
        """Frames of channels, and what cameras see."""
        self.remote_control = RemoteControl(self._robots)
        """Who drives whose robot."""

    def find_robot(self, client: Client) -> Robot | None:
        """Robot of a client; None before INIT."""
        return self._robots.get(client)

    def remove(self, client: Client) -> str | None:
        """Remove the robot of a client, and return the name, which is free again."""
        robot = self._robots.pop(client, None)
        if robot is None:
            return None
        self._collision_index.invalidate(robot)
        self.cameras.release(robot)
        self.remote_control.release(client)
        # The name is free at once: a client that reconnects spawns under its old name.
        log.info("robot %s removed", robot.name)
        return robot.name

    def execute(self, client: Client, command: Command, time_s: float) -> None:
        """Execute a command of a client.

        Commands to a robot that is not spawned, or without power, have no effect, as in USARSim.
        """
        robot = self._robots.get(client)
        # One case a class, without guards and without a default: a new command fails the type
        # check here, and at run time raises instead of being ignored.
        match command:
            case Init():
                if robot is None:
                    self._spawn(client, command, time_s)
            case GetStartPoses():
                client.deliver([StartPoses(self._world.starts)])
            # Without power, too: notes, configuration and geometry move nothing.
            case Note():
                # The control port has no reply to a rejected note.
                with suppress(LocalProtocolError, RejectedError):
                    self.publish(client, command, time_s)
            case ShareControl(shared):
                self.remote_control.share(client, shared, time_s)
            case GetConf():
                if robot is not None:
                    client.deliver(execute_get_conf(robot, command, self._error_bound_of))
            case GetGeo():
                if robot is not None:
                    client.deliver(execute_get_geo(robot, command))
            case (
                Drive()
                | DriveJoints()
                | MultiDrive()
                | MisPkg()
                | SetCommand()
                | SetViewports()
                | Trace()
            ):
                if robot is not None and robot.has_power(time_s):
                    if isinstance(command, Drive):
                        self.remote_control.release(client)
                    reports = execute_control(robot, command, time_s, partial(self.sense, robot))
                    if reports:
                        client.deliver(reports)
            case Stepper():
                pass  # the port marks the steps that follow
            case StepCommand():
                raise AssertionError("STEP advances the clock: the simulation loop executes it")
            case _:
                assert_never(command)

    def _spawn(self, client: Client, init: Init, time_s: float) -> None:
        """Spawn the robot of a client, or reject INIT with the reason."""
        try:
            description, body, is_moved = self._place_robot(init)
        except SpawnError as error:
            log.warning("INIT of class %r rejected: %s", init.class_name, error)
            client.finish_init(InitResult(time_s, failure=str(error)))
            return
        existing = {robot.name for robot in self._robots.values()}
        name = unique_name(init.name or description.model_name, existing)
        self._num_spawned += 1
        robot = Robot(
            description,
            body,
            name=name,
            seed=self._seed,
            time_s=time_s,
            number=self._num_spawned,
        )
        robot.commands.add(init, time_s)
        self._robots[client] = robot
        log.info("robot %s of class %s spawned at %s", name, description.class_name, body.pose)
        if description.stand_in:
            log.warning("robot %s is %s", name, description.stand_in)
        moved_to = None
        if is_moved:
            log.info("robot %s moved there: the requested place is not free", name)
            moved_to = robot.location_m
        client.finish_init(InitResult(time_s, name, moved_to))
        # Before the first CONF of the cameras, which names their tiles.
        self.cameras.assign_tiles(robot)
        # The first cycle confirms the spawn, there is no other reply; UDK's clients learn from
        # CONF of the cameras which tile of the image is theirs.
        tiled = [camera.configuration() for camera in robot.all_cameras if camera.tile]
        client.deliver([*robot.read_due(time_s, partial(self.sense, robot)), *tiled])

    def _place_robot(self, init: Init) -> tuple[RobotDescription, RobotBody, bool]:
        """Class of a new robot, its base, and whether it stands elsewhere than INIT says.

        Raises:
            SpawnError: No class, start or free place answers to INIT.
        """
        if len(self._robots) >= _MAX_ROBOTS:
            raise SpawnError(f"the limit of {_MAX_ROBOTS} robots is reached")
        robots = self._robots.values()
        return place_robot(init, self._classes, self._world.starts, self._collision_index, robots)

    def set_accuracy_target(self, event: AccuracyTargetChanged) -> tuple[ViewRequest | None, str]:
        """Change the accuracy target of a client's camera.

        Returns:
            The view of the camera as the next frames have it, None without such a camera; and the
            name of the camera.
        """
        robot = self._robots.get(event.client)
        omnis = robot.omni_cameras if robot else []
        named = (omni for omni in omnis if event.camera.lower() in ("", omni.name.lower()))
        omni = next(named, None)
        if robot is None or omni is None:
            return None, event.camera
        omni.set_accuracy_target(max_error_px=event.max_error_px, budget_ms=event.budget_ms)
        # As tiled: the plan depends on the size that the image port renders.
        return self.cameras.request_view(robot, omni), omni.name

    def publish(self, client: Client, note: Note, time_s: float) -> None:
        """Store a note about a client's robot.

        Raises:
            RejectedError: The client has no robot.
            LocalProtocolError: The robot has notes of as many other names as it may.
        """
        robot = self._robots.get(client)
        if robot is None:
            raise RejectedError("this client has no robot")
        robot.publish(note, time_s)

    def get_state(
        self, name: str, commands_after: int | None = None, ticks_after: float | None = None
    ) -> FleetState:
        """All robots; readings, notes, commands after a number and ticks after a time of the robot
        of a name, empty for the displayed one.
        """
        robot = self.cameras.find_robot(name)
        return collect_fleet_state(self._robots.values(), robot, commands_after, ticks_after)

    def sense(self, robot: Robot) -> SensorEnvironment:
        """Environment of a robot, with the other robots as boxes at their present poses."""
        return self._environment.sense(robot)

    def read_sensors(self, client: Client, time_s: float) -> list[Report]:
        """Reports of a whole cycle of a client's robot; empty without one."""
        robot = self._robots.get(client)
        if robot is None:
            return []
        try:
            # It draws random numbers, as no other reading at this time would.
            robot.commands.add(StepCommand(0.0), time_s)
            # A function for the environment: computed only if a sensor is due.
            return robot.read_all(time_s, partial(self.sense, robot))
        except Exception:
            self._mark_faulty(client, robot)
            return []

    def step(self, duration_s: float, time_s: float) -> None:
        """Move all robots by one tick that ends at a time."""
        # One after the other, each against the present poses of the others: in one pass no two
        # robots can enter the same gap.
        for client, robot in self._robots.items():
            try:
                before, mishap = robot.world_from_robot, robot.mishap
                move = self._collision_index.mover_of(robot, self._robots.values())
                robot.step(duration_s, time_s, move)
                if robot.mishap not in ("", mishap):
                    log.warning("robot %s %s", robot.name, robot.mishap)
            except Exception:
                self._mark_faulty(client, robot)
            if robot.world_from_robot is not before:
                self._collision_index.invalidate(robot)

    def deliver_due_reports(self, time_s: float) -> None:
        """Deliver the reports that are due at a time, one batch a client."""
        for client, robot in self._robots.items():
            try:
                reports = robot.read_due(time_s, partial(self.sense, robot))
            except Exception:
                self._mark_faulty(client, robot)
                continue
            if reports:
                client.deliver(reports)

    def _mark_faulty(self, client: Client, robot: Robot) -> None:
        """Have the robot removed after this tick; called while its exception is handled."""
        log_fault(log, "robot %s failed and is removed", robot.name)
        self._faulty.append(client)

    def pop_faulty_clients(self) -> list[Client]:
        """Clients whose robots raised since the last call; the caller removes the robots."""
        faulty, self._faulty = self._faulty, []
        return faulty
