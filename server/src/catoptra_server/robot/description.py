"""What a robot file describes: body, drive, sensors, and the omnidirectional camera's three groups.

Frozen data in SI units; frame: robot (SAE, origin in the chassis at `ride_height_m` above the
floor).
"""

from __future__ import annotations

from dataclasses import dataclass

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.cube import Face
from catoptra_protocol.optics.frames import Pose
from catoptra_server.robot.render_wish import RenderWish


@dataclass(frozen=True, slots=True)
class DriveBase:
    """A skid-steered base. Speeds are of wheel spin; slips are what the floor takes of them.

    turn_slip: part of each turn that is lost. slip_noise: standard deviation of each wheel side's
    random slip after one metre, in metres; it grows with the root of the way.
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


@dataclass(frozen=True, slots=True)
class OdometryDescription:
    """Wheel odometry and what is wrong with it. Noises grow with the root of what was travelled.

    distance_scale, turn_scale: reported over true rolling. drift_rad_per_m: steady turn to the
    right (clockwise) that is not there. distance_noise_m: standard deviation after 1 m.
    turn_noise_rad: after 1 rad of turn. heading_noise_rad: after 1 m.
    """

    name: str
    interval_s: float
    distance_scale: float = 1.0
    turn_scale: float = 1.0
    drift_rad_per_m: float = 0.0
    distance_noise_m: float = 0.0
    turn_noise_rad: float = 0.0
    heading_noise_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class GroundTruthDescription:
    """The robot's true pose, printed with `decimals`."""

    name: str
    interval_s: float
    decimals: int


SensorDescription = OdometryDescription | GroundTruthDescription


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
    frame_interval_s: the shortest time between two exposures; 0 = as fast as it can be drawn.
    """

    name: str
    camera: OmniCamera
    robot_from_mirror: Pose
    texture_clients: tuple[TextureClient, ...]
    wish: RenderWish
    frame_interval_s: float
    capture_fov_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class RobotDescription:
    """One robot class, such as USARBot.OmniP2AT."""

    class_name: str
    drive: DriveBase
    sensors: tuple[SensorDescription, ...]
    omni_camera: OmniCameraDescription | None
    status_interval_s: float
    battery_s: float

    @property
    def model_name(self) -> str:
        """Return the class without its package: what CONF and GEO call the robot."""
        return self.class_name.rpartition(".")[2]

    @property
    def viewpoint_height_m(self) -> float:
        """Return the height of the effective viewpoint above the floor; 0 without a camera."""
        if self.omni_camera is None:
            return 0.0
        return self.drive.ride_height_m - float(self.omni_camera.robot_from_mirror.translation[2])
