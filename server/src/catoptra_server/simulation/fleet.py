"""All robots that are alive, one for each client: spawning, commands, motion, what is shown."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from functools import partial

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
    Set,
    SetViewports,
)
from catoptra_protocol.usarsim.reports import Report, StartPose, StartPoses
from catoptra_server.frames.frame_request import (
    CameraChannel,
    Channel,
    FrameComposition,
    ImagePortChannel,
    OmniCameraSpec,
)
from catoptra_server.frames.image_port_layout import (
    ImagePortLayout,
    VisibleObjects,
    compose_camera_frame,
    find_displayed_robot,
)
from catoptra_server.frames.multi_view import TileLayout
from catoptra_server.robot.robot_description import RobotDescription
from catoptra_server.scene.oriented_box import OrientedBox
from catoptra_server.scene.scene_mesh import SceneMesh
from catoptra_server.scene.world_description import World
from catoptra_server.sensors.camera import RobotCamera
from catoptra_server.sensors.sensor_environment import EmptyScene, RayCaster, SensorEnvironment
from catoptra_server.simulation.collision_index import CollisionIndex
from catoptra_server.simulation.get_commands import (
    ErrorBoundLookup,
    execute_get_conf,
    execute_get_geo,
)
from catoptra_server.simulation.landmark_visibility import (
    LandmarkVisibility,
    compute_landmark_visibility,
)
from catoptra_server.simulation.robot import Robot
from catoptra_server.simulation.robot_meshes import RobotMeshes
from catoptra_server.simulation.set_commands import execute_set
from catoptra_server.simulation.simulation_events import AccuracyTargetChanged, Client
from catoptra_server.simulation.spawning import find_class, spawn_pose, unique_name

log = logging.getLogger(__name__)

# Width and height of the screen of robots without an omnidirectional camera, while none is there.
_DEFAULT_BLANK_SIZE_PX = (320, 240)


class Fleet:
    """The robots of one world, of one or several classes. Only the simulation thread may call it.

    multi_view: the screen's tiles; None: the screen shows one robot's viewports. error_bound_of: how far
    off pictures are, where that is known.
    """

    def __init__(
        self,
        descriptions: Sequence[RobotDescription],
        world: World,
        scene: SceneMesh,
        *,
        seed: int,
        ray_caster: RayCaster | None = None,
        multi_view: TileLayout | None = None,
        error_bound_of: ErrorBoundLookup = lambda eye: None,
    ) -> None:
        self._classes = tuple(descriptions)
        self._world = world
        self._seed = seed
        self._error_bound_of = error_bound_of
        self._ray_caster = ray_caster or EmptyScene()
        self._robots: dict[Client, Robot] = {}
        self._collision_index = CollisionIndex(scene, self._classes)
        self._robot_meshes = RobotMeshes(self._classes)
        self._image_port_layout = ImagePortLayout(
            multi_view, blank_size_px=_blank_size_px(self._classes)
        )

    def find_robot(self, client: Client) -> Robot | None:
        """Return a client's robot, if it has one."""
        return self._robots.get(client)

    def other_robots(self, except_robot: Robot | None) -> list[Robot]:
        """Return all robots but one: those that its cameras see."""
        return [robot for robot in self._robots.values() if robot is not except_robot]

    def other_robot_boxes(self, except_robot: Robot | None) -> tuple[OrientedBox, ...]:
        """Return the boxes of all robots but one: world_from_box, and length, width, height."""
        return tuple(
            self._collision_index.bounding_box(robot) for robot in self.other_robots(except_robot)
        )

    def remove(self, client: Client) -> str | None:
        """Take a client's robot out of the world; return its name, now free, if it had one."""
        robot = self._robots.pop(client, None)
        if robot is None:
            return None
        self._collision_index.invalidate(robot)
        self._image_port_layout.release(robot)
        log.info("robot %s left", robot.name)
        return robot.name

    def execute(self, client: Client, command: Command, time_s: float) -> None:
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
                client.deliver(execute_get_conf(robot, command, self._error_bound_of))
            case GetGeo() if robot:
                client.deliver(execute_get_geo(robot, command))
            case _ if robot and robot.has_power(time_s):
                self._handle(client, robot, command, time_s)

    def _handle(self, client: Client, robot: Robot, command: Command, time_s: float) -> None:
        match command:
            case Drive():
                robot.drive_wheels(command, time_s)
            case DriveJoints(joints):
                for joint in joints:
                    robot.drive_joint(joint.name, joint.value, joint.order)
            case MultiDrive(joints):
                for name, value in joints:
                    robot.drive_joint(name, value, 0)
            case MisPkg():
                robot.drive_mission_package(command)
            case SetViewports():
                client.deliver([robot.viewports.execute(command, time_s)])
            case Set():
                client.deliver(
                    execute_set(robot, command, robot.sensor_context(time_s, self.sense(robot)))
                )

    def _spawn(self, client: Client, init: Init, time_s: float) -> None:
        description = find_class(self._classes, init.class_name)
        pose = spawn_pose(init, self._world.starts)
        if description is None or pose is None:
            log.warning(
                "INIT of class %r at %r refused: this server has %s, starts %s",
                init.class_name,
                init.start or init.location_m,
                ", ".join(known.class_name for known in self._classes),
                [start.name for start in self._world.starts],
            )
            client.reject_init()
            return
        name = unique_name(
            init.name or description.model_name, {r.name for r in self._robots.values()}
        )
        robot = Robot(description, pose, name=name, seed=self._seed, time_s=time_s)
        self._robots[client] = robot
        self._image_port_layout.assign_tiles(robot)
        log.info("robot %s of class %s spawned at %s", name, description.class_name, pose)
        tiled = [camera.configuration() for camera in robot.all_cameras if camera.tile]
        client.deliver([*robot.read_due(time_s, partial(self.sense, robot)), *tiled])

    def _start_poses(self) -> StartPoses:
        poses = [StartPose(s.name, s.location_m, s.rotation_rad) for s in self._world.starts]
        return StartPoses(tuple(poses))

    def set_accuracy_target(
        self, event: AccuracyTargetChanged
    ) -> tuple[OmniCameraSpec | None, str]:
        """Draw a client's camera as asked; return its eye, None where there is none, and name."""
        robot = self._robots.get(event.client)
        omni = robot.omni_camera if robot else None
        if omni is None or event.camera.lower() not in ("", omni.name.lower()):
            return None, event.camera
        omni.set_accuracy_target(max_error_px=event.max_error_px, budget_ms=event.budget_ms)
        return omni.camera_spec(omni.tile), omni.name

    def sense(self, robot: Robot) -> SensorEnvironment:
        """Return what is around a robot now."""
        world = self._world
        return SensorEnvironment(
            scene=self._ray_caster,
            robot_boxes=self.other_robot_boxes(robot),
            rfid_tags=world.rfid_tags,
            victims=world.victims,
            gps_origin=world.gps_origin,
        )

    def read_sensors(self, client: Client, time_s: float) -> list[Report]:
        """Return a whole cycle of a client's robot; nothing without one."""
        robot = self._robots.get(client)
        return robot.read_all(time_s, partial(self.sense, robot)) if robot else []

    def step(self, duration_s: float, time_s: float) -> None:
        """Move every robot for one tick that ends at a time, one after the other."""
        for robot in self._robots.values():
            obstacles = self._collision_index.obstacles_near(robot, self._robots.values())
            robot.step(duration_s, time_s, obstacles)
            if robot.is_rolling:
                self._collision_index.invalidate(robot)

    def deliver_due_reports(self, time_s: float) -> None:
        """Deliver to each client what its sensors have to say by now."""
        for client, robot in self._robots.items():
            reports = robot.read_due(time_s, partial(self.sense, robot))
            if reports:
                client.deliver(reports)

    def compose_frame(self, channel: Channel) -> FrameComposition | None:
        """Return what a channel shows now; None: no such robot or camera."""
        robots = list(self._robots.values())
        match channel:
            case ImagePortChannel(tile):
                return self._image_port_layout.compose_frame(
                    robots, self._visible_objects, tile=tile
                )
            case CameraChannel():
                found = self._find_camera(channel)
                return compose_camera_frame(*found, self._visible_objects) if found else None

    def compute_landmark_visibility(
        self, channel: CameraChannel
    ) -> tuple[LandmarkVisibility, ...] | None:
        """Return what a camera sees of the landmarks now; None: no such robot or camera."""
        found = self._find_camera(channel)
        if found is None:
            return None
        robot, camera = found
        take = camera.view_request(robot.world_from_robot, joint_angles_rad=robot.joint_angles_rad)
        return compute_landmark_visibility(take, self._world.landmarks, self.sense(robot))

    def _find_camera(self, channel: CameraChannel) -> tuple[Robot, RobotCamera] | None:
        robot = _find_robot_by_name(list(self._robots.values()), channel.robot)
        camera = robot.find_camera(channel.camera) if robot else None
        return (robot, camera) if robot and camera else None

    def _visible_objects(self, robot: Robot) -> VisibleObjects:
        seen = self._robot_meshes
        return VisibleObjects(seen.dynamic_objects(self.other_robots(robot)), seen.ego_body(robot))


def _find_robot_by_name(robots: Sequence[Robot], name: str) -> Robot | None:
    """Return a robot by its name; by an empty one the robot that is watched."""
    if not name:
        return find_displayed_robot(robots)
    return next((robot for robot in robots if robot.name == name), None)


def _blank_size_px(classes: Sequence[RobotDescription]) -> tuple[int, int]:
    """Return width and height of the screen before there is a robot."""
    cameras = [d.omni_camera.camera for d in classes if d.omni_camera]
    return (cameras[0].width_px, cameras[0].height_px) if cameras else _DEFAULT_BLANK_SIZE_PX
