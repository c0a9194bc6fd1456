"""All robots that are alive, one for each client: spawning, commands, motion, pictures."""

from __future__ import annotations

import logging

import numpy as np

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_protocol.wire.commands import Command, Drive, GetConf, GetGeo, GetStartPoses, Init
from catoptra_protocol.wire.reports import Configuration, Geometry, Report, StartPose, StartPoses
from catoptra_server.render.renderer import RenderedImage, View
from catoptra_server.robot.description import RobotDescription
from catoptra_server.robot.pose import PlanarPose
from catoptra_server.scene.description import World
from catoptra_server.scene.meshes import SceneMesh
from catoptra_server.scene.obstacles import CLEARANCE_M, obstacles_between
from catoptra_server.sensors.omni_camera import OmniCameraSensor
from catoptra_server.simulation.requests import Client
from catoptra_server.simulation.spawned_robot import SpawnedRobot

log = logging.getLogger(__name__)

# The mirror rises above the viewpoint; anything lower than this above it is in the way.
_MIRROR_ABOVE_VIEWPOINT_M = 0.1


class Fleet:
    """The robots of one world. Only the simulation thread may call it."""

    def __init__(
        self,
        description: RobotDescription,
        world: World,
        scene: SceneMesh,
        *,
        view: View | None,
        seed: int,
    ) -> None:
        self._is = description
        self._world = world
        self._view = view
        self._seed = seed
        self._robots: dict[Client, SpawnedRobot] = {}
        height = max(description.viewpoint_height_m, description.drive.dimensions_m[2])
        self._obstacles = obstacles_between(
            scene, low_m=CLEARANCE_M, high_m=height + _MIRROR_ABOVE_VIEWPOINT_M
        )

    @property
    def frame_interval_s(self) -> float:
        """Return the shortest time between two exposures."""
        camera = self._is.omni_camera
        return camera.frame_interval_s if camera else 0.0

    def robot_of(self, client: Client) -> SpawnedRobot | None:
        """Return a client's robot, if it has one."""
        return self._robots.get(client)

    def remove(self, client: Client) -> None:
        """Take a client's robot out of the world; its name is free again."""
        robot = self._robots.pop(client, None)
        if robot is not None:
            log.info("robot %s left", robot.name)

    def obey(self, client: Client, command: Command, time_s: float) -> None:
        """Carry out a command; what needs a robot and has none is ignored, as USARSim does."""
        robot = self._robots.get(client)
        match command:
            case Init():
                self._spawn(client, command, time_s)
            case GetStartPoses():
                client.deliver([self._start_poses()])
            case Drive() if robot:
                robot.obey(command, time_s)
            case GetConf(type_, name) if robot:
                client.deliver(_configurations(robot, type_, name))
            case GetGeo(type_, name) if robot:
                client.deliver([_geometry(robot, type_, name)])
            case _:
                pass

    def _spawn(self, client: Client, init: Init, time_s: float) -> None:
        pose = self._spawn_pose(init)
        if not self._is_known(init.class_name) or pose is None:
            log.warning(
                "INIT of class %r at %r refused: this server has %s, starts %s",
                init.class_name,
                init.start or init.location_m,
                self._is.class_name,
                [start.name for start in self._world.starts],
            )
            client.refuse_init()
            return
        name = self._free_name(init.name or self._is.model_name)
        robot = SpawnedRobot(
            self._is, pose, name=name, seed=self._seed, time_s=time_s, camera=self._camera()
        )
        self._robots[client] = robot
        log.info("robot %s of class %s spawned at %s", name, self._is.class_name, pose)
        client.deliver(robot.due_readings(time_s))

    def _is_known(self, class_name: str) -> bool:
        """Return whether a class is ours; the package may be left out, case does not matter."""
        known = (self._is.class_name.lower(), self._is.model_name.lower())
        return class_name.lower() in known

    def _spawn_pose(self, init: Init) -> PlanarPose | None:
        """Return where to put a robot: on the floor, upright, whatever height and tilt."""
        if init.location_m is not None:
            (x, y, _), (_, _, yaw) = init.location_m, init.rotation_rad
            return PlanarPose(x, y, wrap_angle(yaw))
        for start in self._world.starts:
            if init.start is not None and start.name.lower() == init.start.lower():
                (x, y, _), (_, _, yaw) = start.location_m, start.rotation_rad
                return PlanarPose(x, y, wrap_angle(yaw))
        return None

    def _free_name(self, wished: str) -> str:
        taken = {robot.name for robot in self._robots.values()}
        numbered = (f"{wished}{number}" for number in range(2, len(taken) + 3))
        return wished if wished not in taken else next(n for n in numbered if n not in taken)

    def _camera(self) -> OmniCameraSensor | None:
        if self._is.omni_camera is None or self._view is None:
            return None
        return OmniCameraSensor(
            self._is.omni_camera, self._view, viewpoint_height_m=self._is.viewpoint_height_m
        )

    def _start_poses(self) -> StartPoses:
        poses = [StartPose(s.name, s.location_m, s.rotation_rad) for s in self._world.starts]
        return StartPoses(tuple(poses))

    def move(self, duration_s: float, time_s: float) -> None:
        """Move every robot for one tick that ends at a time."""
        for robot in self._robots.values():
            robot.move(duration_s, time_s, self._obstacles)

    def report_due(self, time_s: float) -> None:
        """Deliver to each client what its sensors have to say by now."""
        for client, robot in self._robots.items():
            reports = robot.due_readings(time_s)
            if reports:
                client.deliver(reports)

    def picture(self) -> tuple[RenderedImage, str, Pose]:
        """Return the picture of the watched camera, its name, and world_from_robot.

        The watched camera is that of the robot that has been here longest. Without one the picture
        is black, as USARSim's is before a robot comes.
        """
        for robot in self._robots.values():
            if robot.camera is not None:
                pose = robot.world_from_robot
                return robot.camera.expose(pose), robot.camera.name, pose
        return self._black(), "", Pose.identity()

    def _black(self) -> RenderedImage:
        camera = self._is.omni_camera
        size = (camera.camera.height_px, camera.camera.width_px) if camera else (360, 360)
        return RenderedImage(np.zeros((*size, 3), dtype=np.uint8), {})


def _configurations(robot: SpawnedRobot, type_: str, name: str | None) -> list[Report]:
    """Return one CONF a part, as UT2004; the empty form where nothing matches."""
    found = robot.configurations(type_)
    wanted = (name or "").lower()
    # The robot answers by its model's name to whatever name it is asked for.
    if name and type_.lower() != "robot":
        found = [c for c in found if (c.get("Name") or "").lower() == wanted]
    empty = Configuration(type_, (("Name", name),) if name else ())
    return list(found) or [empty]


def _geometry(robot: SpawnedRobot, type_: str, name: str | None) -> Report:
    """Return one GEO with all matching parts."""
    if type_.lower() == "robot":
        return robot.own_geometry()
    items = [
        item
        for item in robot.geometries(type_)
        if name is None or item.name.lower() == name.lower()
    ]
    return Geometry(type_, tuple(items), name=None if items else name)
