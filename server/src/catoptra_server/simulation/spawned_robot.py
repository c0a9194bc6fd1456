"""One robot that is alive: body, sensors, camera, battery, and when each of them reports next."""

from __future__ import annotations

import dataclasses

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.commands import Drive
from catoptra_protocol.wire.numbers import fixed
from catoptra_protocol.wire.reports import (
    Configuration,
    GeometryItem,
    Report,
    VehicleGeometry,
    VehicleStatus,
)
from catoptra_server.random_streams import RandomStream
from catoptra_server.robot.body import Body, driven
from catoptra_server.robot.description import RobotDescription
from catoptra_server.robot.pose import PlanarPose
from catoptra_server.robot.skid_steer import WheelSpin
from catoptra_server.scene.obstacles import Obstacles
from catoptra_server.sensors import Part, Sensor, build_sensor
from catoptra_server.sensors.omni_camera import OmniCameraSensor

# Two due times that differ by less than this are the same tick: due times are sums of periods.
_SAME_TIME_S = 1e-6
# The status among the due times; no sensor has an empty name.
_STATUS = ""


class SpawnedRobot:
    """A robot of one client. Its random numbers depend on the seed and its name alone."""

    def __init__(
        self,
        description: RobotDescription,
        pose: PlanarPose,
        *,
        name: str,
        seed: int,
        time_s: float,
        camera: OmniCameraSensor | None,
    ) -> None:
        self.name = name
        self.camera = camera
        self._is = description
        self._body = Body(description.drive, pose, WheelSpin())
        self._slip = RandomStream.of(seed, name, "slip")
        self._sensors: list[Sensor] = [
            build_sensor(sensor, description.drive, RandomStream.of(seed, name, sensor.name))
            for sensor in description.sensors
        ]
        self._due_s = dict.fromkeys([*(s.name for s in self._sensors), _STATUS], time_s)
        self._battery_ends_s = time_s + description.battery_s
        self._light = False

    @property
    def world_from_robot(self) -> Pose:
        """Return where the chassis frame is."""
        return self._body.pose.at_height(self._is.drive.ride_height_m)

    def obey(self, drive: Drive, time_s: float) -> None:
        """Take over wheel speeds; a side that is not named keeps its own. Not without battery."""
        if time_s >= self._battery_ends_s:
            return
        unit = self._is.drive.max_speed_rad_s / 100.0 if drive.normalized else 1.0
        spin = self._body.spin
        left = spin.left_rad_s if drive.left is None else unit * drive.left
        right = spin.right_rad_s if drive.right is None else unit * drive.right
        limited = WheelSpin(left, right).limited(self._is.drive.max_speed_rad_s)
        self._body = dataclasses.replace(self._body, spin=limited)
        self._light = self._light if drive.light is None else drive.light

    def move(self, duration_s: float, time_s: float, obstacles: Obstacles) -> None:
        """Roll for a tick that ends at a time; sensors follow."""
        if time_s >= self._battery_ends_s:
            self._body = dataclasses.replace(self._body, spin=WheelSpin())
        self._body, way = driven(self._body, duration_s, obstacles=obstacles, stream=self._slip)
        for sensor in self._sensors:
            sensor.follow(way, self._body.tick)

    def all_readings(self, time_s: float) -> list[Report]:
        """Return a whole cycle: every sensor, then STA, as UT2004 orders them."""
        pose = self.world_from_robot
        return [*(s.reading(time_s, pose) for s in self._sensors), self._status(time_s)]

    def due_readings(self, time_s: float) -> list[Report]:
        """Return what is due by now, and set the next times."""
        pose = self.world_from_robot
        reports: list[Report] = [
            sensor.reading(time_s, pose)
            for sensor in self._sensors
            if self._is_due(sensor.name, sensor.interval_s, time_s)
        ]
        if self._is_due(_STATUS, self._is.status_interval_s, time_s):
            reports.append(self._status(time_s))
        return reports

    def _is_due(self, name: str, interval_s: float, time_s: float) -> bool:
        if time_s < self._due_s[name] - _SAME_TIME_S:
            return False
        # From the due time, not from now, so that a period keeps its mean; after a pause, from now.
        self._due_s[name] = max(self._due_s[name] + interval_s, time_s)
        return True

    def _status(self, time_s: float) -> VehicleStatus:
        left_s = max(0, int(self._battery_ends_s - time_s))
        return VehicleStatus(time_s, left_s, light=self._light)

    def configurations(self, type_: str) -> list[Configuration]:
        """Return CONF of all parts of a type, in any case; of the robot itself for Robot."""
        if type_.lower() == "robot":
            return [self._own_configuration()]
        return [part.configuration() for part in self._parts(type_)]

    def geometries(self, type_: str) -> list[GeometryItem]:
        """Return where all parts of a type are mounted."""
        return [part.geometry() for part in self._parts(type_)]

    def _parts(self, type_: str) -> list[Part]:
        camera: list[Part] = [self.camera] if self.camera else []
        parts = [*self._sensors, *camera]
        return [part for part in parts if part.type.lower() == type_.lower()]

    def _own_configuration(self) -> Configuration:
        drive = self._is.drive
        pairs = (
            ("Name", self._is.model_name),
            ("SteeringType", "SkidSteered"),
            ("Mass", fixed(drive.mass_kg)),
            ("MaxSpeed", fixed(drive.max_speed_rad_s)),
            ("MaxTorque", fixed(drive.max_torque)),
            ("MaxFrontSteer", fixed(0.0)),
            ("MaxRearSteer", fixed(0.0)),
        )
        return Configuration("GroundVehicle", pairs)

    def own_geometry(self) -> VehicleGeometry:
        """Return GEO of the robot itself."""
        drive = self._is.drive
        return VehicleGeometry(
            name=self._is.model_name,
            dimensions_m=drive.dimensions_m,
            cog_m=(0.0, 0.0, 0.0),
            wheel_radius_m=drive.wheel_radius_m,
            wheel_separation_m=drive.wheel_separation_m,
            wheel_base_m=drive.wheel_base_m,
        )
