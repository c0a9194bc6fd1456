"""All robots that are alive, one for each client: spawning, commands, motion, what is shown."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import partial

from catoptra_protocol.wire.commands import (
    Command,
    Drive,
    DriveJoints,
    GetConf,
    GetGeo,
    GetStartPoses,
    Init,
    MisPkg,
    MultiDrive,
    Set,
    SetViewports,
)
from catoptra_protocol.wire.reports import Report, StartPose, StartPoses
from catoptra_server.imaging.multi_view import TileLayout
from catoptra_server.imaging.shot import CameraChannel, Channel, OmniEye, Scenery, ScreenChannel
from catoptra_server.robot.description import RobotDescription
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh
from catoptra_server.scene.oriented_box import OrientedBox
from catoptra_server.sensors.camera import Camera
from catoptra_server.sensors.sight import Nothing, RayCaster, Surroundings
from catoptra_server.simulation.answers import BoundOf, configurations, geometries
from catoptra_server.simulation.appearance import Appearance
from catoptra_server.simulation.requests import Client, DialTurned
from catoptra_server.simulation.screen import Around, Screen, own_scenery, watched
from catoptra_server.simulation.set_commands import obey_set
from catoptra_server.simulation.sightings import Sighting, sightings
from catoptra_server.simulation.spawned_robot import SpawnedRobot
from catoptra_server.simulation.spawning import class_named, free_name, spawn_pose
from catoptra_server.simulation.traffic import Traffic

log = logging.getLogger(__name__)

# Width and height of the screen of robots without an omnidirectional camera, while none is there.
_BLACK_PX = (320, 240)


class Fleet:
    """The robots of one world, of one or several classes. Only the simulation thread may call it.

    multi_view: the screen's tiles; None: the screen shows one robot's viewports. bound_of: how far
    off pictures are, where that is known.
    """

    def __init__(
        self,
        descriptions: Sequence[RobotDescription],
        world: World,
        scene: SceneMesh,
        *,
        seed: int,
        caster: RayCaster | None = None,
        multi_view: TileLayout | None = None,
        bound_of: BoundOf = lambda eye: None,
    ) -> None:
        self._classes = tuple(descriptions)
        self._world = world
        self._seed = seed
        self._bound_of = bound_of
        self._caster = caster or Nothing()
        self._robots: dict[Client, SpawnedRobot] = {}
        self._traffic = Traffic(scene, self._classes)
        self._appearance = Appearance(self._classes)
        self._screen = Screen(multi_view, black_px=_black_px(self._classes))

    def robot_of(self, client: Client) -> SpawnedRobot | None:
        """Return a client's robot, if it has one."""
        return self._robots.get(client)

    def others(self, except_robot: SpawnedRobot | None) -> list[SpawnedRobot]:
        """Return all robots but one: those that its cameras see."""
        return [robot for robot in self._robots.values() if robot is not except_robot]

    def bodies(self, except_robot: SpawnedRobot | None) -> tuple[OrientedBox, ...]:
        """Return the boxes of all robots but one: world_from_box, and length, width, height."""
        return tuple(self._traffic.box(robot) for robot in self.others(except_robot))

    def remove(self, client: Client) -> str | None:
        """Take a client's robot out of the world; return its name, now free, if it had one."""
        robot = self._robots.pop(client, None)
        if robot is None:
            return None
        self._traffic.forget(robot)
        self._screen.forget(robot)
        log.info("robot %s left", robot.name)
        return robot.name

    def obey(self, client: Client, command: Command, time_s: float) -> None:
        """Carry out a command; what needs a robot and has none is ignored, as USARSim does.

        TRACE is accepted and draws nothing; without battery nothing but questions is heard.
        """
        robot = self._robots.get(client)
        match command:
            case Init() if robot is None:
                self._spawn(client, command, time_s)
            case GetStartPoses():
                client.deliver([self._start_poses()])
            case GetConf() if robot:
                client.deliver(configurations(robot, command, self._bound_of))
            case GetGeo() if robot:
                client.deliver(geometries(robot, command))
            case _ if robot and robot.is_alive(time_s):
                self._steer(client, robot, command, time_s)

    def _steer(self, client: Client, robot: SpawnedRobot, command: Command, time_s: float) -> None:
        match command:
            case Drive():
                robot.obey(command, time_s)
            case DriveJoints(joints):
                for joint in joints:
                    robot.drive_joint(joint.name, joint.value, joint.order)
            case MultiDrive(joints):
                for name, value in joints:
                    robot.drive_joint(name, value, 0)
            case MisPkg():
                robot.drive_package(command)
            case SetViewports():
                client.deliver([robot.viewports.obey(command, time_s)])
            case Set():
                client.deliver(obey_set(robot, command, robot.moment(time_s, self.look(robot))))

    def _spawn(self, client: Client, init: Init, time_s: float) -> None:
        description = class_named(self._classes, init.class_name)
        pose = spawn_pose(init, self._world.starts)
        if description is None or pose is None:
            log.warning(
                "INIT of class %r at %r refused: this server has %s, starts %s",
                init.class_name,
                init.start or init.location_m,
                ", ".join(known.class_name for known in self._classes),
                [start.name for start in self._world.starts],
            )
            client.refuse_init()
            return
        name = free_name(
            init.name or description.model_name, {r.name for r in self._robots.values()}
        )
        robot = SpawnedRobot(description, pose, name=name, seed=self._seed, time_s=time_s)
        self._robots[client] = robot
        self._screen.welcome(robot)
        log.info("robot %s of class %s spawned at %s", name, description.class_name, pose)
        tiled = [camera.configuration() for camera in robot.all_cameras if camera.tile]
        client.deliver([*robot.due_readings(time_s, partial(self.look, robot)), *tiled])

    def _start_poses(self) -> StartPoses:
        poses = [StartPose(s.name, s.location_m, s.rotation_rad) for s in self._world.starts]
        return StartPoses(tuple(poses))

    def turn_dial(self, asked: DialTurned) -> tuple[OmniEye | None, str]:
        """Draw a client's camera as asked; return its eye, None where there is none, and name."""
        robot = self._robots.get(asked.client)
        omni = robot.camera if robot else None
        if omni is None or asked.camera.lower() not in ("", omni.name.lower()):
            return None, asked.camera
        omni.turn_dial(max_error_px=asked.max_error_px, budget_ms=asked.budget_ms)
        return omni.eye(omni.tile), omni.name

    def look(self, robot: SpawnedRobot) -> Surroundings:
        """Return what is around a robot now."""
        world = self._world
        return Surroundings(
            scene=self._caster,
            bodies=self.bodies(robot),
            tags=world.tags,
            victims=world.victims,
            gps_origin=world.gps_origin,
        )

    def readings(self, client: Client, time_s: float) -> list[Report]:
        """Return a whole cycle of a client's robot; nothing without one."""
        robot = self._robots.get(client)
        return robot.all_readings(time_s, partial(self.look, robot)) if robot else []

    def move(self, duration_s: float, time_s: float) -> None:
        """Move every robot for one tick that ends at a time, one after the other."""
        for robot in self._robots.values():
            obstacles = self._traffic.around(robot, self._robots.values())
            robot.move(duration_s, time_s, obstacles)
            if robot.is_rolling:
                self._traffic.forget(robot)

    def report_due(self, time_s: float) -> None:
        """Deliver to each client what its sensors have to say by now."""
        for client, robot in self._robots.items():
            reports = robot.due_readings(time_s, partial(self.look, robot))
            if reports:
                client.deliver(reports)

    def scenery(self, channel: Channel) -> Scenery | None:
        """Return what a channel shows now; None: no such robot or camera."""
        robots = list(self._robots.values())
        match channel:
            case ScreenChannel(tile):
                return self._screen.scenery(robots, self._around_of, tile=tile)
            case CameraChannel():
                found = self._camera(channel)
                return own_scenery(*found, self._around_of) if found else None

    def sightings(self, channel: CameraChannel) -> tuple[Sighting, ...] | None:
        """Return what a camera sees of the landmarks now; None: no such robot or camera."""
        found = self._camera(channel)
        if found is None:
            return None
        robot, camera = found
        take = camera.take(robot.world_from_robot, joints=robot.joints)
        return sightings(take, self._world.landmarks, self.look(robot))

    def _camera(self, channel: CameraChannel) -> tuple[SpawnedRobot, Camera] | None:
        robot = _named(list(self._robots.values()), channel.robot)
        camera = robot.camera_named(channel.camera) if robot else None
        return (robot, camera) if robot and camera else None

    def _around_of(self, robot: SpawnedRobot) -> Around:
        seen = self._appearance
        return Around(seen.bodies(self.others(robot)), seen.own_body(robot))


def _named(robots: Sequence[SpawnedRobot], name: str) -> SpawnedRobot | None:
    """Return a robot by its name; by an empty one the robot that is watched."""
    if not name:
        return watched(robots)
    return next((robot for robot in robots if robot.name == name), None)


def _black_px(classes: Sequence[RobotDescription]) -> tuple[int, int]:
    """Return width and height of the screen before there is a robot."""
    cameras = [d.omni_camera.camera for d in classes if d.omni_camera]
    return (cameras[0].width_px, cameras[0].height_px) if cameras else _BLACK_PX
