"""What a robot file describes: body, drive, cameras, and the parts that other modules describe.

Frozen data in SI units; frame: robot (SAE, origin in the chassis at `ride_height_m` above the
floor).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.effect import NO_EFFECT_SETTINGS, EffectSettings
from catoptra_server.robot.joint_chain import MissionPackageDescription
from catoptra_server.robot.mount import Mount
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.robot.sensor_descriptions import (
    EncoderDescription,
    GpsDescription,
    GroundTruthDescription,
    InsDescription,
    OdometryDescription,
    RangeScannerDescription,
    RfidDescription,
    SensorDescription,
    SonarDescription,
    TachometerDescription,
    TouchDescription,
    VictimSensorDescription,
)


@dataclass(frozen=True, slots=True)
class DriveBase:
    """A skid-steered base. Speeds are of wheel spin; slips are what the floor takes of them.

    turn_slip: part of each turn that is lost. slip_noise: standard deviation of each wheel side's
    random slip after one metre, in metres; it grows with the root of the way. dimensions_m: what
    GEO reports, length, width, height; collision_dimensions_m: the body's own where that is no body
    (UDK's P3AT reports wheel base, track, 0).
    """

    wheel_radius_m: float
    wheel_separation_m: float
    wheel_base_m: float
    dimensions_m: tuple[float, float, float]
    ride_height_m: float
    mass_kg: float
    max_speed_rad_s: float
    max_torque: float
    turn_slip: float
    slip_noise: float
    collision_dimensions_m: tuple[float, float, float] | None = None

    @property
    def collision_size_m(self) -> tuple[float, float, float]:
        """Return length, width and height of what stands in others' way, from the floor up."""
        return self.collision_dimensions_m or self.dimensions_m


@dataclass(frozen=True, slots=True)
class TextureClient:
    """One CameraTextureClient: a virtual camera at the effective viewpoint and its texture."""

    face: Face
    texture: str
    fov_rad: float
    size_px: int


@dataclass(frozen=True, slots=True, eq=False)
class OmniCameraDescription:
    """The paper's three groups: mirror and its split, five texture clients, the capture camera.

    name: the capture camera's. robot_from_mirror: where the effective viewpoint is.
    min_frame_interval_s: the shortest time between two exposures; 0 = as fast as it can be drawn.
    effects: what lens and sensor may do to the picture.
    """

    name: str
    camera: OmniCamera
    robot_from_mirror: Pose
    texture_clients: tuple[TextureClient, ...]
    render_settings: RenderSettings
    min_frame_interval_s: float
    capture_fov_rad: float
    effects: EffectSettings = NO_EFFECT_SETTINGS


@dataclass(frozen=True, slots=True)
class PerspectiveCameraDescription:
    """An ordinary perspective camera: fields of view are horizontal; SET Camera FOV may zoom."""

    name: str
    mount: Mount
    width_px: int
    height_px: int
    fov_rad: float
    min_fov_rad: float
    max_fov_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class RobotDescription:
    """One robot class, such as USARBot.OmniP2AT. chassis_joints: its own joints, such as flippers."""

    class_name: str
    drive: DriveBase
    sensors: tuple[SensorDescription, ...]
    omni_camera: OmniCameraDescription | None
    status_interval_s: float
    battery_s: float
    perspective_cameras: tuple[PerspectiveCameraDescription, ...] = ()
    mission_packages: tuple[MissionPackageDescription, ...] = ()
    chassis_joints: MissionPackageDescription | None = None

    @property
    def model_name(self) -> str:
        """Return the class without its package: what CONF and GEO call the robot."""
        return self.class_name.rpartition(".")[2]

    def robot_from_part(self, name: str, joint_angles_rad: Mapping[str, float]) -> Pose:
        """Return where a link or a joint carries what is mounted on it; else the chassis.

        joints: radians by lower-case link name.
        """
        for package in (*self.mission_packages, *filter(None, (self.chassis_joints,))):
            for number, link in enumerate(package.links, 1):
                if link.name.lower() == name.lower():
                    return package.robot_from_link(number, joint_angles_rad)
        return Pose.identity()

    @property
    def viewpoint_height_m(self) -> float:
        """Return the height of the effective viewpoint above the floor; 0 without a camera."""
        if self.omni_camera is None:
            return 0.0
        return self.drive.ride_height_m - float(self.omni_camera.robot_from_mirror.translation[2])


__all__ = [
    "PerspectiveCameraDescription",
    "DriveBase",
    "EncoderDescription",
    "GpsDescription",
    "GroundTruthDescription",
    "InsDescription",
    "MissionPackageDescription",
    "Mount",
    "OdometryDescription",
    "OmniCameraDescription",
    "RangeScannerDescription",
    "RfidDescription",
    "RobotDescription",
    "SensorDescription",
    "SonarDescription",
    "TachometerDescription",
    "TextureClient",
    "TouchDescription",
    "VictimSensorDescription",
]
