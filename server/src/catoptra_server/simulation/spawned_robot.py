"""One robot that is alive: body, sensors, cameras, packages, battery, and when they report next."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.commands import Drive, MisPkg
from catoptra_protocol.wire.reports import (
    Report,
    VehicleConfiguration,
    VehicleGeometry,
    VehicleStatus,
)
from catoptra_server.effects.frame_key import FrameKey
from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.body import Body, driven
from catoptra_server.robot.description import RobotDescription
from catoptra_server.robot.pose import PlanarPose
from catoptra_server.robot.skid_steer import WheelSpin
from catoptra_server.scene.motion import AT_REST, Twist
from catoptra_server.scene.obstacles import Obstacles
from catoptra_server.scene.oriented_box import OrientedBox
from catoptra_server.sensors import Moment, Move, Part, Sensor, build_sensors
from catoptra_server.sensors.camera import Camera
from catoptra_server.sensors.mission_package import MissionPackage
from catoptra_server.sensors.omni_camera import OmniCameraSensor
from catoptra_server.sensors.perspective_camera import PerspectiveCameraSensor
from catoptra_server.sensors.sight import EMPTY, Surroundings
from catoptra_server.simulation.schedule import Schedule
from catoptra_server.simulation.viewports import Viewports

Look = Callable[[], Surroundings]

# What the floor's random numbers are called.
_FLOOR = "slip"


class SpawnedRobot:
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
        self.camera = _omni_camera(description)
        self.cameras = [PerspectiveCameraSensor(c, description) for c in description.cameras]
        self.packages = [MissionPackage(package) for package in description.packages]
        parts = description.joint_parts
        self._joint_parts = [MissionPackage(parts)] if parts else []
        self.sensors: list[Sensor] = build_sensors(
            description.sensors,
            description.drive,
            lambda part: RandomStream.of(seed, name, _numbers_of(part)),
        )
        self._body = Body(description.drive, pose, WheelSpin())
        self._slip = RandomStream.of(seed, name, _FLOOR)
        intervals = [sensor.interval_s for sensor in self.sensors]
        self._schedule = Schedule([*intervals, description.status_interval_s], time_s)
        self._battery_ends_s = time_s + description.battery_s
        self._light = False
        self.twist = AT_REST
        self.viewports = Viewports([camera.name for camera in self.all_cameras])
        self.view = -1

    @property
    def world_from_robot(self) -> Pose:
        """Return where the chassis frame is."""
        return self._body.pose.at_height(self.description.drive.ride_height_m)

    @property
    def is_rolling(self) -> bool:
        """Return whether its wheels are told to turn."""
        return self._body.spin != WheelSpin()

    @property
    def box(self) -> OrientedBox:
        """Return the body as others see and touch it: a box that stands on the floor."""
        size_m = self.description.drive.body_m
        return OrientedBox(self._body.pose.at_height(0.5 * size_m[2]), size_m)

    @property
    def all_cameras(self) -> list[Camera]:
        """Return its cameras, the omnidirectional one first."""
        return [*([self.camera] if self.camera else []), *self.cameras]

    def camera_named(self, name: str) -> Camera | None:
        """Return a camera by its name in any case, if it has it; the first by an empty name."""
        named = (c for c in self.all_cameras if name.lower() in ("", c.name.lower()))
        return next(named, None)

    def frame_key(self, camera: str) -> FrameKey:
        """Return what the noise of a camera's picture is keyed by now."""
        stream = RandomStream.of(self._seed, self.name, f"noise of {camera}")
        return FrameKey.of(stream, self._body.tick)

    @property
    def joints(self) -> dict[str, float]:
        """Return radians of its own and all packages' joints by link name in lower case."""
        chains = (*self._joint_parts, *self.packages)
        return {name: angle for chain in chains for name, angle in chain.angles().items()}

    def is_alive(self, time_s: float) -> bool:
        """Return whether the battery still has some: without, no command is obeyed."""
        return time_s < self._battery_ends_s

    def obey(self, drive: Drive, time_s: float) -> None:
        """Take over wheel speeds; a side that is not named keeps its own. Not without battery."""
        if not self.is_alive(time_s):
            return
        fastest = self.description.drive.max_speed_rad_s
        unit = fastest / 100.0 if drive.normalized else 1.0
        spin = self._body.spin
        left = spin.left_rad_s if drive.left is None else unit * drive.left
        right = spin.right_rad_s if drive.right is None else unit * drive.right
        self._body = dataclasses.replace(self._body, spin=WheelSpin(left, right).limited(fastest))
        self._light = self._light if drive.light is None else drive.light

    def drive_joint(self, name: str, value: float | None, order: int) -> None:
        """Command a joint by its link's name; a name that no joint has is ignored."""
        for package in (*self._joint_parts, *self.packages):
            number = package.number_of(name)
            if number is not None and value is not None:
                package.command(number, value, order)

    def drive_package(self, command: MisPkg) -> None:
        """Command the links of a package; there are no grippers and no sequences."""
        for package in self.packages:
            if package.name.lower() == command.name.lower():
                for link in command.links:
                    if link.value is not None:
                        package.command(link.link, link.value, link.order)

    def move(self, duration_s: float, time_s: float, obstacles: Obstacles) -> None:
        """Roll for a tick that ends at a time; joints and sensors follow."""
        if not self.is_alive(time_s):
            self._body = dataclasses.replace(self._body, spin=WheelSpin())
        else:
            for package in (*self._joint_parts, *self.packages):
                package.move(duration_s)
        before = self._body.pose
        self._body, way = driven(self._body, duration_s, obstacles=obstacles, stream=self._slip)
        self.twist = _twist(before, self._body.pose, duration_s)
        move = Move(way, self._body.tick, duration_s, self._body.pose)
        for sensor in self.sensors:
            sensor.follow(move)

    def moment(self, time_s: float, around: Surroundings = EMPTY) -> Moment:
        """Return what the sensors can know of now."""
        return Moment(time_s, self._body.tick, self.world_from_robot, around, self.joints)

    def all_readings(self, time_s: float, look: Look = lambda: EMPTY) -> list[Report]:
        """Return a whole cycle: every sensor, packages, then STA, as UT2004 orders them."""
        return self._readings(range(len(self.sensors) + 1), time_s, look)

    def due_readings(self, time_s: float, look: Look = lambda: EMPTY) -> list[Report]:
        """Return what is due by now, and set the next times."""
        return self._readings(self._schedule.due(time_s), time_s, look)

    def _readings(self, which: Sequence[int], time_s: float, look: Look) -> list[Report]:
        """Return the reports of some of the sensors; the number after the last is the status."""
        if not which:
            return []
        moment = self.moment(time_s, look())
        due = [i for i in which if i < len(self.sensors)]
        reports: list[Report] = [self.sensors[i].reading(moment) for i in due]
        if len(due) < len(which):
            reports += [*(p.status(time_s) for p in self.packages), self._status(time_s)]
        return reports

    def _status(self, time_s: float) -> VehicleStatus:
        left_s = max(0, int(self._battery_ends_s - time_s))
        joints = tuple(joint for chain in self._joint_parts for joint in chain.named_angles())
        return VehicleStatus(time_s, left_s, light=self._light, view=self.view, joints=joints)

    def parts(self, type_: str) -> list[Part]:
        """Return all parts of a type, in any case, in the order of their reports."""
        reporting = (part for sensor in self.sensors for part in sensor.parts)
        parts: list[Part] = [*reporting, *self.all_cameras, *self.packages]
        return [part for part in parts if part.type.lower() == type_.lower()]

    def own_configuration(self) -> VehicleConfiguration:
        """Return CONF of the robot itself."""
        drive = self.description.drive
        return VehicleConfiguration(
            name=self.description.model_name,
            mass_kg=drive.mass_kg,
            max_speed_rad_s=drive.max_speed_rad_s,
            max_torque=drive.max_torque,
        )

    def own_geometry(self) -> VehicleGeometry:
        """Return GEO of the robot itself."""
        drive = self.description.drive
        return VehicleGeometry(
            name=self.description.model_name,
            dimensions_m=drive.dimensions_m,
            cog_m=(0.0, 0.0, 0.0),
            wheel_radius_m=drive.wheel_radius_m,
            wheel_separation_m=drive.wheel_separation_m,
            wheel_base_m=drive.wheel_base_m,
        )


def _twist(before: PlanarPose, after: PlanarPose, duration_s: float) -> Twist:
    """Return the mean motion of a tick, in plain numbers: every robot has one in every tick."""
    if before == after:
        return AT_REST
    turn_rad = math.remainder(after.yaw_rad - before.yaw_rad, math.tau)
    way = ((after.x_m - before.x_m) / duration_s, (after.y_m - before.y_m) / duration_s, 0.0)
    return Twist(way, (0.0, 0.0, turn_rad / duration_s))


def _omni_camera(description: RobotDescription) -> OmniCameraSensor | None:
    omni = description.omni_camera
    if omni is None:
        return None
    return OmniCameraSensor(omni, viewpoint_height_m=description.viewpoint_height_m)


def _numbers_of(part: str) -> str:
    """Return what a part's random numbers are called: like the part, unless the floor's are.

    No part's name has a space.
    """
    return f"part {part}" if part == _FLOOR else part
