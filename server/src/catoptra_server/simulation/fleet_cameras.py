"""The cameras of all robots, and what cameras and sensors of a robot may see.

`FleetCameras` finds robot and camera of a channel, composes frames and answers queries about what a
camera sees; `FleetEnvironment` is the world with the other robots as boxes, for one robot;
`RobotMeshes` are the robots as cameras show them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import assert_never
from weakref import WeakKeyDictionary

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.configurations import CHASSIS_MOUNT
from catoptra_server.frames.frame import (
    CameraChannel,
    Channel,
    FrameComposition,
    ImagePortChannel,
    ViewRequest,
)
from catoptra_server.frames.image_port import (
    CameraRobot,
    ImagePortLayout,
    MountedCamera,
    VisibleObjects,
    compose_camera_frame,
    compose_variant,
    find_displayed_robot,
)
from catoptra_server.frames.multi_view import TileLayout
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.simulation.collision_index import CollisionIndex
from catoptra_server.simulation.commands import ErrorBoundLookup
from catoptra_server.simulation.robot import CameraSensor, Robot
from catoptra_server.simulation.robot_bodies import build_ego_mesh, build_outer_meshes
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.simulation.sensors import RayCaster, SensorEnvironment
from catoptra_server.simulation.sensors.omni_camera import OmniCameraSensor
from catoptra_server.simulation.sight import (
    LandmarkVisibility,
    NamedScene,
    PixelView,
    compute_landmark_visibility,
    look_through_pixel,
)
from catoptra_server.world.objects import DynamicObject, ObjectMesh
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import AT_REST, World


class FleetEnvironment:
    """World and robots as sensors and views meet them."""

    def __init__(
        self,
        robots: Collection[Robot],
        world: World,
        scene: SceneMesh,
        ray_caster: RayCaster,
        collision_index: CollisionIndex,
    ) -> None:
        """Create the environment of a fleet.

        Args:
            robots: All robots; a view, in which robots come and go.
            world: Landmarks, tags, victims and GPS origin.
            scene: The world as triangles, for names of items.
            ray_caster: The world as sensors measure it.
            collision_index: Boxes of robots at their present poses.
        """
        self._robots = robots
        self._world = world
        self.landmarks = world.landmarks
        self._scene = scene
        self._ray_caster = ray_caster
        self._collision_index = collision_index

    def sense(self, robot: Robot) -> SensorEnvironment:
        """Environment of a robot, with the other robots as boxes at their present poses."""
        world = self._world
        return SensorEnvironment(
            scene=self._ray_caster,
            robot_boxes=tuple(map(self._collision_index.bounding_box, self._others(robot))),
            rfid_tags=world.rfid_tags,
            victims=world.victims,
            gps_origin=world.gps_origin,
        )

    def name_objects(self, robot: Robot) -> NamedScene:
        """Everything that a robot's cameras may see, by name."""
        others = self._others(robot)
        return NamedScene(
            self._scene,
            self._ray_caster,
            [other.name for other in others],
            [self._collision_index.bounding_box(other) for other in others],
        )

    def _others(self, robot: Robot) -> list[Robot]:
        return [one for one in self._robots if one is not robot and one.is_solid]


# Width and height of the black image of a server whose robots have no omnidirectional camera.
_DEFAULT_BLANK_SIZE_PX = (320, 240)


class FleetCameras:
    """Cameras of all robots. Only the simulation thread may call methods, except `resolve`."""

    def __init__(
        self,
        robots: Collection[Robot],
        classes: Sequence[RobotDescription],
        environment: FleetEnvironment,
        *,
        multi_view: TileLayout | None = None,
        error_bound_of: ErrorBoundLookup = lambda camera: None,
    ) -> None:
        """Create the cameras of a fleet.

        Args:
            robots: Robots in the order of spawning; a view, in which robots come and go.
            classes: Classes that robots may have.
            environment: What the cameras may see.
            multi_view: Tiles of the image port; None for the viewports of one robot.
            error_bound_of: Error bound of a camera; None before the first frame.
        """
        self._robots = robots
        self._environment = environment
        self._error_bound_of = error_bound_of
        self._meshes = RobotMeshes(classes)
        # Replaced as a whole, so that other threads may read it.
        self._names: dict[tuple[str, str], tuple[str, str]] = {}
        self._layout = ImagePortLayout(multi_view, blank_size_px=_blank_size_px(classes))

    def assign_tiles(self, robot: Robot) -> None:
        """Assign free tiles to the cameras of a new robot."""
        self._layout.assign_tiles(robot)
        self._names = self._list_names()

    def release(self, robot: Robot) -> None:
        """Free the tiles of a robot that is removed."""
        self._layout.release(robot)
        self._names = self._list_names()

    def _list_names(self) -> dict[tuple[str, str], tuple[str, str]]:
        """Names of robot and camera, by each pair of names that may stand for them."""
        names: dict[tuple[str, str], tuple[str, str]] = {}
        displayed = find_displayed_robot(self._robots)
        for robot in self._robots:
            for camera in robot.all_cameras:
                for robot_name in (robot.name, "") if robot is displayed else (robot.name,):
                    for camera_name in (camera.name.lower(), ""):
                        names.setdefault((robot_name, camera_name), (robot.name, camera.name))
        return names

    def resolve(self, channel: Channel) -> Channel:
        """The one channel of a camera, whatever names a request has for it; from any thread.

        Without such a robot at present it stays: commands on their way may spawn the robot.
        """
        if not isinstance(channel, CameraChannel):
            return channel
        found = self._names.get((channel.robot, channel.camera.lower()))
        return replace(channel, robot=found[0], camera=found[1]) if found else channel

    def compose_frame(self, channel: Channel) -> FrameComposition | None:
        """Compose the frame of a channel; None without such a robot or camera."""
        match channel:
            case ImagePortChannel(tile):
                return self._layout.compose_frame(self._robots, self._visible_objects, tile=tile)
            case CameraChannel():
                found = self.find(channel)
                if found is None:
                    return None
                composition = compose_camera_frame(*found, self._visible_objects)
                variant = channel.variant
                return composition if variant is None else compose_variant(composition, variant)
            case _:
                assert_never(channel)

    def request_view(self, robot: Robot, camera: OmniCameraSensor) -> ViewRequest:
        """View of a camera now, as tiled."""
        return MountedCamera(robot, camera).request_view(camera.tile, self._visible_objects)

    def compute_landmark_visibility(
        self, channel: CameraChannel
    ) -> tuple[LandmarkVisibility, ...] | None:
        """Landmarks in view of a camera; None without such a robot or camera."""
        found = self.find(channel)
        if found is None:
            return None
        robot, camera = found
        return compute_landmark_visibility(
            camera.camera_spec(),
            _find_pose(robot, camera),
            self._environment.landmarks,
            self._environment.sense(robot),
        )

    def look_through_pixel(
        self, channel: CameraChannel, point_px: tuple[float, float]
    ) -> PixelView | None:
        """What a camera sees at a point of the image; None without such a robot or camera."""
        found = self.find(channel)
        if found is None:
            return None
        robot, camera = found
        spec = camera.camera_spec()
        return look_through_pixel(
            spec,
            _find_pose(robot, camera),
            point_px,
            self._environment.name_objects(robot),
            self._error_bound_of(spec) if isinstance(spec, OmniCameraSpec) else None,
        )

    def find(self, channel: CameraChannel) -> tuple[Robot, CameraSensor] | None:
        """Robot and camera of a channel; without a robot's name, of the displayed robot."""
        robot = self.find_robot(channel.robot)
        camera = robot.find_camera(channel.camera) if robot else None
        return (robot, camera) if robot and camera else None

    def find_robot(self, name: str) -> Robot | None:
        """Robot of an exact name; the displayed one for an empty name."""
        # Names of robots are unique with their case, as `unique_name` compares them.
        if name:
            return next((robot for robot in self._robots if robot.name == name), None)
        return find_displayed_robot(self._robots)

    def _visible_objects(self, robot: CameraRobot) -> VisibleObjects:
        others = [other for other in self._robots if other is not robot]
        return VisibleObjects(self._meshes.dynamic_objects(others), self._meshes.ego_body(robot))


def _blank_size_px(classes: Sequence[RobotDescription]) -> tuple[int, int]:
    """Width and height of the image port's image before the first robot."""
    # The size that the first robot will have: clients need not resize at the first INIT.
    cameras = [omni.camera for robot in classes for omni in robot.omni_cameras]
    return (cameras[0].width_px, cameras[0].height_px) if cameras else _DEFAULT_BLANK_SIZE_PX


def _find_pose(robot: Robot, camera: CameraSensor) -> Pose:
    """world_from_camera at present."""
    return robot.world_from_robot @ camera.robot_from_camera(robot.joint_angles_rad)


_PlacedRobot = tuple[Mapping[str, float], tuple[DynamicObject, ...]]
_NO_ANGLES: Mapping[str, float] = {}


class RobotMeshes:
    """The meshes of a fleet's classes, each built once, when it is first seen."""

    def __init__(self, descriptions: Sequence[RobotDescription]) -> None:
        self._classes = {d.class_name: d for d in descriptions}
        # Renderers recognize a mesh by identity: a mesh built anew would be uploaded anew. A start
        # builds none: 30 to 130 ms each of a body of parts.
        self._outer = cache(build_outer_meshes)
        self._ego = cache(build_ego_mesh)
        # With the angles of joints; forgotten with its robot.
        self._objects: WeakKeyDictionary[CameraRobot, _PlacedRobot] = WeakKeyDictionary()

    def dynamic_objects(self, robots: Iterable[CameraRobot]) -> tuple[DynamicObject, ...]:
        """Robots as dynamic objects, at their present poses; the same in all views of a tick."""
        return tuple(one for robot in robots for one in self._find_objects(robot))

    def _find_objects(self, robot: CameraRobot) -> tuple[DynamicObject, ...]:
        description = self._classes[robot.class_name]
        meshes = self._outer(description)
        if not meshes:
            return ()
        angles = robot.joint_angles_rad if len(meshes) > 1 else _NO_ANGLES
        known, found = self._objects.get(robot, (None, ()))
        if (
            known != angles
            or found[-1].world_from_object is not robot.world_from_robot
            or found[-1].twist is not robot.twist
        ):
            found = tuple(
                _place_mesh(mesh, robot, description, link, angles) for link, mesh in meshes.items()
            )
            self._objects[robot] = angles, found
        return found

    def ego_body(self, robot: CameraRobot) -> DynamicObject | None:
        """Parts of a robot that its own mirror may show; None unless the effect is configured."""
        description = self._classes[robot.class_name]
        mesh = self._ego(description)
        return None if mesh is None else _place_mesh(mesh, robot, description)


def _place_mesh(
    mesh: ObjectMesh,
    robot: CameraRobot,
    description: RobotDescription,
    link: str = CHASSIS_MOUNT,
    angles_rad: Mapping[str, float] = _NO_ANGLES,
) -> DynamicObject:
    pose, twist = robot.world_from_robot, robot.twist
    if link != CHASSIS_MOUNT:
        pose = pose @ description.robot_from_part(link, angles_rad)
        if twist is not AT_REST:
            twist = twist.at_offset(pose.translation - robot.world_from_robot.translation)
    return DynamicObject(mesh, pose, twist, robot.name, robot.number)
