"""One robot that is alive: body, sensors, cameras, packages, battery, and when they report next."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.commands import Drive, MisPkg
from catoptra_protocol.usarsim.reports import (
    Report,
    VehicleConfiguration,
    VehicleGeometry,
    VehicleStatus,
)
from catoptra_server.capture.noise_seed import NoiseSeed
from catoptra_server.random_sources import RandomSource
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.robot.robot_body import RobotBody, step
from catoptra_server.robot.robot_description import RobotDescription
from catoptra_server.robot.skid_steer import WheelSpin
from catoptra_server.scene.obstacle_grid import ObstacleGrid
from catoptra_server.scene.oriented_box import OrientedBox
from catoptra_server.scene.twist import AT_REST, Twist
from catoptra_server.sensors import MotionStep, Part, Sensor, SensorContext, build_sensors
from catoptra_server.sensors.camera import RobotCamera
from catoptra_server.sensors.mission_package import MissionPackage
from catoptra_server.sensors.omni_camera import OmniCameraSensor
from catoptra_server.sensors.perspective_camera import PerspectiveCameraSensor
from catoptra_server.sensors.sensor_environment import EMPTY_ENVIRONMENT, SensorEnvironment
from catoptra_server.simulation.report_schedule import ReportSchedule
from catoptra_server.simulation.viewports import Viewports

EnvironmentProvider = Callable[[], SensorEnvironment]

# What the floor's random numbers are called.
_SLIP_STREAM = "slip"


class Robot:
    """A robot of one client. Its random numbers depend on the seed and its name alone.

    view: the tile of its first camera in a multi-view, -1 without. twist: how it really moved in
    the last tick, told at the chassis in the world's axes.
    """

    def __init__(
        self,
        description: RobotDescription,
        pose: PlanarPose,
        *,
        name: str,
        seed: int,
        time_s: float,
    ) -> None:
        self.name = name
        self.description = description
        self._seed = seed
        self.omni_camera = _build_omni_camera(description)
        self.perspective_cameras = [
            PerspectiveCameraSensor(c, description) for c in description.perspective_cameras
        ]
        self.mission_packages = [
            MissionPackage(package) for package in description.mission_packages
        ]
        parts = description.chassis_joints
        self._chassis_joints = [MissionPackage(parts)] if parts else []
        self.sensors: list[Sensor] = build_sensors(
            description.sensors,
            description.drive,
            lambda part: RandomSource.from_names(seed, name, _stream_name(part)),
        )
        self._body = RobotBody(description.drive, pose, WheelSpin())
        self._slip = RandomSource.from_names(seed, name, _SLIP_STREAM)
        intervals = [sensor.interval_s for sensor in self.sensors]
        self._schedule = ReportSchedule([*intervals, description.status_interval_s], time_s)
        self._battery_empty_s = time_s + description.battery_s
        self._light = False
        self.twist = AT_REST
        self.viewports = Viewports([camera.name for camera in self.all_cameras])
        self.tile_index = -1

    @property
    def world_from_robot(self) -> Pose:
        """Return where the chassis frame is."""
        return self._body.pose.at_height(self.description.drive.ride_height_m)

    @property
    def is_rolling(self) -> bool:
        """Return whether its wheels are told to turn."""
        return self._body.spin != WheelSpin()

    @property
    def bounding_box(self) -> OrientedBox:
        """Return the body as others see and touch it: a box that stands on the floor."""
        size_m = self.description.drive.collision_size_m
        return OrientedBox(self._body.pose.at_height(0.5 * size_m[2]), size_m)

    @property
    def all_cameras(self) -> list[RobotCamera]:
        """Return its cameras, the omnidirectional one first."""
        return [*([self.omni_camera] if self.omni_camera else []), *self.perspective_cameras]

    def find_camera(self, name: str) -> RobotCamera | None:
        """Return a camera by its name in any case, if it has it; the first by an empty name."""
        named = (c for c in self.all_cameras if name.lower() in ("", c.name.lower()))
        return next(named, None)

    def noise_seed_for(self, camera: str) -> NoiseSeed:
        """Return what the noise of a camera's picture is keyed by now."""
        stream = RandomSource.from_names(self._seed, self.name, f"noise of {camera}")
        return NoiseSeed.from_source(stream, self._body.tick)

    @property
    def joint_angles_rad(self) -> dict[str, float]:
        """Return radians of its own and all packages' joints by link name in lower case."""
        chains = (*self._chassis_joints, *self.mission_packages)
        return {name: angle for chain in chains for name, angle in chain.joint_angles_rad().items()}

    def has_power(self, time_s: float) -> bool:
        """Return whether the battery still has some: without, no command is obeyed."""
        return time_s < self._battery_empty_s

    def drive_wheels(self, drive: Drive, time_s: float) -> None:
        """Take over wheel speeds; a side that is not named keeps its own. Not without battery."""
        if not self.has_power(time_s):
            return
        fastest = self.description.drive.max_speed_rad_s
        unit = fastest / 100.0 if drive.normalized else 1.0
        spin = self._body.spin
        left = spin.left_rad_s if drive.left is None else unit * drive.left
        right = spin.right_rad_s if drive.right is None else unit * drive.right
        self._body = dataclasses.replace(self._body, spin=WheelSpin(left, right).clamp(fastest))
        self._light = self._light if drive.light is None else drive.light

    def drive_joint(self, name: str, value: float | None, order: int) -> None:
        """Command a joint by its link's name; a name that no joint has is ignored."""
        for package in (*self._chassis_joints, *self.mission_packages):
            number = package.find_link_number(name)
            if number is not None and value is not None:
                package.command_joint(number, value, order)

    def drive_mission_package(self, command: MisPkg) -> None:
        """Command the links of a package; there are no grippers and no sequences."""
        for package in self.mission_packages:
            if package.name.lower() == command.name.lower():
                for link in command.links:
                    if link.value is not None:
                        package.command_joint(link.link, link.value, link.order)

    def step(self, duration_s: float, time_s: float, obstacles: ObstacleGrid) -> None:
        """Roll for a tick that ends at a time; joints and sensors follow."""
        if not self.has_power(time_s):
            self._body = dataclasses.replace(self._body, spin=WheelSpin())
        else:
            for package in (*self._chassis_joints, *self.mission_packages):
                package.step(duration_s)
        before = self._body.pose
        self._body, way = step(self._body, duration_s, obstacles=obstacles, stream=self._slip)
        self.twist = _mean_twist(before, self._body.pose, duration_s)
        move = MotionStep(way, self._body.tick, duration_s, self._body.pose)
        for sensor in self.sensors:
            sensor.update(move)

    def sensor_context(
        self, time_s: float, environment: SensorEnvironment = EMPTY_ENVIRONMENT
    ) -> SensorContext:
        """Return what the sensors can know of now."""
        return SensorContext(
            time_s, self._body.tick, self.world_from_robot, environment, self.joint_angles_rad
        )

    def read_all(
        self, time_s: float, sense: EnvironmentProvider = lambda: EMPTY_ENVIRONMENT
    ) -> list[Report]:
        """Return a whole cycle: every sensor, packages, then STA, as UT2004 orders them."""
        return self._read(range(len(self.sensors) + 1), time_s, sense)

    def read_due(
        self, time_s: float, sense: EnvironmentProvider = lambda: EMPTY_ENVIRONMENT
    ) -> list[Report]:
        """Return what is due by now, and set the next times."""
        return self._read(self._schedule.pop_due(time_s), time_s, sense)

    def _read(
        self, indices: Sequence[int], time_s: float, sense: EnvironmentProvider
    ) -> list[Report]:
        """Return the reports of some of the sensors; the number after the last is the status."""
        if not indices:
            return []
        moment = self.sensor_context(time_s, sense())
        due = [i for i in indices if i < len(self.sensors)]
        reports: list[Report] = [self.sensors[i].read(moment) for i in due]
        if len(due) < len(indices):
            reports += [*(p.status(time_s) for p in self.mission_packages), self._status(time_s)]
        return reports

    def _status(self, time_s: float) -> VehicleStatus:
        left_s = max(0, int(self._battery_empty_s - time_s))
        joints = tuple(
            joint for chain in self._chassis_joints for joint in chain.list_joint_angles()
        )
        return VehicleStatus(time_s, left_s, light=self._light, view=self.tile_index, joints=joints)

    def find_parts(self, type_: str) -> list[Part]:
        """Return all parts of a type, in any case, in the order of their reports."""
        reporting = (part for sensor in self.sensors for part in sensor.parts)
        parts: list[Part] = [*reporting, *self.all_cameras, *self.mission_packages]
        return [part for part in parts if part.type.lower() == type_.lower()]

    def vehicle_configuration(self) -> VehicleConfiguration:
        """Return CONF of the robot itself."""
        drive = self.description.drive
        return VehicleConfiguration(
            name=self.description.model_name,
            mass_kg=drive.mass_kg,
            max_speed_rad_s=drive.max_speed_rad_s,
            max_torque=drive.max_torque,
        )

    def vehicle_geometry(self) -> VehicleGeometry:
        """Return GEO of the robot itself."""
        drive = self.description.drive
        return VehicleGeometry(
            name=self.description.model_name,
            dimensions_m=drive.dimensions_m,
            centre_of_gravity_m=(0.0, 0.0, 0.0),
            wheel_radius_m=drive.wheel_radius_m,
            wheel_separation_m=drive.wheel_separation_m,
            wheel_base_m=drive.wheel_base_m,
        )


def _mean_twist(before: PlanarPose, after: PlanarPose, duration_s: float) -> Twist:
    """Return the mean motion of a tick, in plain numbers: every robot has one in every tick."""
    if before == after:
        return AT_REST
    turn_rad = math.remainder(after.yaw_rad - before.yaw_rad, math.tau)
    way = ((after.x_m - before.x_m) / duration_s, (after.y_m - before.y_m) / duration_s, 0.0)
    return Twist(way, (0.0, 0.0, turn_rad / duration_s))


def _build_omni_camera(description: RobotDescription) -> OmniCameraSensor | None:
    omni = description.omni_camera
    if omni is None:
        return None
    return OmniCameraSensor(omni, viewpoint_height_m=description.viewpoint_height_m)


def _stream_name(part: str) -> str:
    """Return what a part's random numbers are called: like the part, unless the floor's are.

    No part's name has a space.
    """
    return f"part {part}" if part == _SLIP_STREAM else part
