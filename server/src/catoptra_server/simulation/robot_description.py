"""Description of a robot class: drive, cameras, sensors and joints, as read from a robot file.

Frozen data in SI units. The robot frame is SAE (x forward, y right, z down) with the origin in the
chassis at `ride_height_m` above the floor. Slip and odometry errors are part of the description.

Mission packages are chains of revolute joints that carry a camera, such as a pan-tilt head. The z
axis of a joint frame is the axis of the joint, as GEO lists joints. At rest an item on a link
is nevertheless aligned with the chassis, as in USARSim, whose parts have frames of their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, Protocol

from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.elementary import arctan2
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.configurations import CHASSIS_MOUNT
from catoptra_protocol.vectors import Vector3
from catoptra_server.effects import NO_EFFECT_SETTINGS, EffectSettings
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.world.world_description import Item

# Orders of a joint command on the wire; the two relative ones add to the present value.
ANGLE, SPEED, BRAKE, RELATIVE_ANGLE, RELATIVE_SPEED = 0, 1, 3, 10, 11
BodyKind = Literal["plain", "wheels", "castor", "tracks"]
"""How cameras show a base: boxes and discs, or parts on wheels, two wheels and a castor, tracks."""
# Number of the chassis among parents.
CHASSIS_PARENT = -1


@dataclass(frozen=True, slots=True)
class LinkDescription:
    """A link and the joint between parent and link."""

    name: str
    parent: int
    """Number of the parent link from 1; -1 for the chassis."""
    position_m: Vector3
    rotation_rad: Vector3
    """Roll, pitch, yaw of the joint frame in the parent's."""
    max_speed_rad_s: float
    max_torque: float
    # USARSim writes a joint without limits as a range whose minimum exceeds the maximum.
    min_rad: float = 1.0
    max_rad: float = 0.0

    def limit_angle(self, angle_rad: float) -> float:
        """Angle limited to the joint's range."""
        if self.min_rad > self.max_rad:
            return angle_rad
        return min(max(angle_rad, self.min_rad), self.max_rad)


@dataclass(frozen=True, slots=True)
class MissionPackageDescription:
    """A named chain of links."""

    name: str
    links: tuple[LinkDescription, ...]

    def robot_from_link(self, number: int, joint_angles_rad: Mapping[str, float]) -> Pose:
        """Pose of an item that a link carries.

        Args:
            number: Number of the link, from 1.
            joint_angles_rad: Angles by lower-case link name; a missing joint is at rest.
        """
        at_rest = self._robot_from_joint(number, {})
        aligned = Pose(at_rest.rotation.T.copy(), Pose.identity().translation)
        return self._robot_from_joint(number, joint_angles_rad) @ aligned

    def _robot_from_joint(self, number: int, joint_angles_rad: Mapping[str, float]) -> Pose:
        link = self.links[number - 1]
        parent_from_joint = Pose.from_rpy(link.position_m, link.rotation_rad)
        angle_rad = joint_angles_rad.get(link.name.lower(), 0.0)
        rotation = Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, angle_rad))
        if link.parent == CHASSIS_PARENT:
            return parent_from_joint @ rotation
        robot_from_parent = self._robot_from_joint(link.parent, joint_angles_rad)
        return robot_from_parent @ parent_from_joint @ rotation


@dataclass(frozen=True, slots=True)
class Joint:
    """State of a joint."""

    link: LinkDescription
    angle_rad: float = 0.0
    target_rad: float = 0.0
    """Angle to move to; infinite for a joint that runs at a speed without limits."""
    speed_rad_s: float = 0.0

    @property
    def velocity_rad_s(self) -> float:
        """Signed speed; 0 at the target."""
        remaining_rad = self.target_rad - self.angle_rad
        return math.copysign(self.speed_rad_s, remaining_rad) if remaining_rad else 0.0

    @property
    def torque(self) -> float:
        """Signed torque: the maximum while the joint moves, as loads are not simulated."""
        velocity = self.velocity_rad_s
        return math.copysign(self.link.max_torque, velocity) if velocity else 0.0

    def apply_command(self, value: float, order: int) -> Joint:
        """Joint under a command: an angle to reach, or a speed to keep.

        Orders of torques are not simulated and leave the joint unchanged.
        """
        if order == ANGLE:
            return self._move_to(value)
        if order == RELATIVE_ANGLE:
            return self._move_to(self.angle_rad + value)
        if order == SPEED:
            return self._run_at(value)
        if order == RELATIVE_SPEED:
            return self._run_at(self.velocity_rad_s + value)
        return self._run_at(0.0) if order == BRAKE else self

    def _move_to(self, angle_rad: float) -> Joint:
        speed_rad_s = self.link.max_speed_rad_s
        return replace(self, target_rad=self.link.limit_angle(angle_rad), speed_rad_s=speed_rad_s)

    def _run_at(self, speed_rad_s: float) -> Joint:
        if not speed_rad_s:
            return replace(self, target_rad=self.angle_rad, speed_rad_s=0.0)
        # A speed is a move to the end of the range, which is infinite for a joint without limits.
        end = self.link.limit_angle(math.copysign(math.inf, speed_rad_s))
        speed = min(abs(speed_rad_s), self.link.max_speed_rad_s)
        return replace(self, target_rad=end, speed_rad_s=speed)

    def step(self, duration_s: float) -> Joint:
        """Joint after a time."""
        if self.angle_rad == self.target_rad:
            return self
        change_rad = self.velocity_rad_s * duration_s
        # Set to the target, not stepped past it: a sum of steps would oscillate around the angle.
        arrives = abs(self.target_rad - self.angle_rad) <= abs(change_rad)
        return replace(self, angle_rad=self.target_rad if arrives else self.angle_rad + change_rad)


def _pan_tilt(name: str) -> MissionPackageDescription:
    """Pan-tilt head of UT2004's robots. Source: GEO and CONF replies of real servers."""
    pan = LinkDescription("CameraPan", CHASSIS_PARENT, (0.1239, 0.0, -0.2036),
                          (math.pi, 0.0, 0.0), 0.17, 20.0)  # fmt: skip
    tilt = LinkDescription("CameraTilt", 1, (0.0, 0.0, 0.0599),
                           (0.5 * math.pi, 0.0, 0.0), 0.17, 20.0)  # fmt: skip
    return MissionPackageDescription(name, (pan, tilt))


# Packages that a file may mount without a section for the class, by class name in lower case.
STANDARD_PACKAGES = {"camerapantilt": _pan_tilt("CameraPanTilt")}


@dataclass(frozen=True, slots=True)
class Mount:
    """Pose of an item in the frame of the parent."""

    position_m: Vector3 = (0.0, 0.0, 0.0)
    rotation_rad: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw."""
    parent: str = CHASSIS_MOUNT
    """Link that carries the item, or CHASSIS_MOUNT."""

    def parent_from_item(self) -> Pose:
        """Transform from the item's frame to the parent's."""
        return Pose.from_rpy(self.position_m, self.rotation_rad)


@dataclass(frozen=True, slots=True)
class PlanarPose:
    """Position in the plane z = 0, and yaw, clockwise seen from above (SAE)."""

    x_m: float
    y_m: float
    yaw_rad: float

    def at_height(self, height_m: float) -> Pose:
        """Transform to the world from an upright frame at a height above the floor."""
        # z points down: a frame above the floor has a negative z.
        return Pose.from_rpy((self.x_m, self.y_m, -height_m), (0.0, 0.0, self.yaw_rad))


@dataclass(frozen=True, slots=True)
class DriveBase:
    """A skid-steered base."""

    wheel_radius_m: float
    wheel_separation_m: float
    wheel_base_m: float
    dimensions_m: tuple[float, float, float]
    """Length, width and height as GEO reports them."""
    ride_height_m: float
    """Height of the chassis origin above the floor."""
    mass_kg: float
    max_speed_rad_s: float
    """Largest wheel spin."""
    max_torque: float
    turn_slip: float
    """Fraction of each turn that is lost to slip."""
    slip_noise: float
    """Standard deviation of the random slip of each side after one metre, in metres; grows with
    the square root of the travel."""
    collision_dimensions_m: tuple[float, float, float] | None = None
    """Length, width and height of the body where GEO reports something else."""
    wheels_m: tuple[tuple[float, float], ...] = ()
    """x and y of the wheels, chassis frame; empty: four, see `wheel_places_m`."""
    step_limit_m: float | None = None
    max_climb_rad: float = math.radians(35.0)
    """Steepest plane that the base climbs: rubber on wood or concrete holds with 0.7."""
    tilt_limit_rad: float | None = None
    is_tripod: bool = False
    """Whether it is no base at all: it stays where it was put, touches nothing and is not seen."""

    @property
    def wheel_places_m(self) -> tuple[tuple[float, float], ...]:
        """x and y of what the base stands on: its wheels, a castor among them."""
        # A base of one axle has a castor somewhere under its body.
        x, y = 0.5 * max(self.wheel_base_m, 0.4 * self.collision_size_m[0]), self.half_track_m
        return self.wheels_m or ((x, -y), (x, y), (-x, -y), (-x, y))

    @property
    def half_track_m(self) -> float:
        """Distance of the wheels from the middle line."""
        return 0.5 * self.wheel_separation_m

    @property
    def max_step_m(self) -> float:
        """Highest step that a wheel climbs; half its radius: there the rim is 60 degrees steep."""
        return 0.5 * self.wheel_radius_m if self.step_limit_m is None else self.step_limit_m

    @property
    def max_tilt_rad(self) -> float:
        """Tilt above which the base slides or falls; where its centre leaves its wheels."""
        if self.tilt_limit_rad is not None:
            return self.tilt_limit_rad
        reach_m = min(max(abs(xy[i]) for xy in self.wheel_places_m) for i in (0, 1))
        return arctan2(reach_m, self.ride_height_m)

    @property
    def collision_size_m(self) -> tuple[float, float, float]:
        """Length, width and height of the body that stops the robot, from the floor up."""
        return self.collision_dimensions_m or self.dimensions_m


@dataclass(frozen=True, slots=True)
class TextureClient:
    """One CameraTextureClient: a virtual camera at the effective viewpoint and its texture."""

    face: Face
    texture: str
    fov_rad: float
    size_px: int


# eq=False here and below: poses hold arrays, whose comparison is no truth value.
@dataclass(frozen=True, slots=True, eq=False)
class OmniCameraDescription:
    """An omnidirectional camera: the paper's three groups (mirror and mesh, five texture clients,
    the capture camera), or a lens, which has no mirror and no texture clients."""

    name: str
    """Name of the capture camera."""
    camera: OmniCamera
    robot_from_mirror: Pose
    """Pose of the mirror frame, whose origin is the effective viewpoint, on its parent."""
    texture_clients: tuple[TextureClient, ...]
    render_settings: RenderSettings
    min_frame_interval_s: float
    """Shortest simulation time between two exposures; 0 sets no limit."""
    capture_fov_rad: float
    """Field of view of the capture camera over the mirror; of a lens the whole one."""
    effects: EffectSettings = NO_EFFECT_SETTINGS
    parent: str = CHASSIS_MOUNT
    """Link that carries the camera, or CHASSIS_MOUNT."""


@dataclass(frozen=True, slots=True)
class PerspectiveCameraDescription:
    """A perspective camera; fields of view are horizontal, the range is for SET Camera FOV."""

    name: str
    mount: Mount
    width_px: int
    height_px: int
    fov_rad: float
    min_fov_rad: float
    max_fov_rad: float
    effects: EffectSettings = NO_EFFECT_SETTINGS


class SensorDescription(Protocol):
    """The part of a sensor's description that all kinds have; each kind's is with its sensor."""

    # Read-only properties: attributes of a protocol would have to be writable, and descriptions
    # are frozen.
    @property
    def name(self) -> str:
        """Name that no other part of the robot has."""

    @property
    def interval_s(self) -> float:
        """Simulation time between two readings."""

    @property
    def mount(self) -> Mount:
        """Mounting pose."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotDescription:
    """One robot class, such as USARBot.OmniP2AT."""

    class_name: str
    drive: DriveBase
    sensors: tuple[SensorDescription, ...]
    omni_cameras: tuple[OmniCameraDescription, ...]
    """Omnidirectional cameras, the one with a mirror first: of those a robot has at most one."""
    status_interval_s: float
    """Simulation time between two STA reports."""
    battery_s: float
    """Simulation time that a full battery lasts."""
    perspective_cameras: tuple[PerspectiveCameraDescription, ...] = ()
    mission_packages: tuple[MissionPackageDescription, ...] = ()
    chassis_joints: MissionPackageDescription | None = None
    """Joints of the robot itself, such as flippers."""
    stand_in: str = ""
    """How the robot differs from USARSim's of this class, logged when it spawns; mostly empty."""
    is_smooth: bool = False
    """Whether cameras show the round parts of a plain body as round, and not facet by facet."""
    body: BodyKind = "wheels"
    items: tuple[Item, ...] = ()
    """What cameras show in place of that body, chassis frame; none: the body."""

    @property
    def model_name(self) -> str:
        """Class without its package: the name of the robot in CONF and GEO."""
        return self.class_name.rpartition(".")[2]

    def robot_from_part(self, name: str, joint_angles_rad: Mapping[str, float]) -> Pose:
        """Pose of an item that a link carries; the chassis for an unknown link.

        Args:
            name: Name of the link in any case.
            joint_angles_rad: Angles by lower-case link name.
        """
        # HARD, the chassis, is the name of no link: the search ends without a match.
        chains = (*self.mission_packages, *filter(None, (self.chassis_joints,)))
        for chain in chains:
            for number, link in enumerate(chain.links, 1):
                if link.name.lower() == name.lower():
                    return chain.robot_from_link(number, joint_angles_rad)
        return Pose.identity()

    @property
    def omni_camera(self) -> OmniCameraDescription | None:
        """First omnidirectional camera, which programs for one camera mean."""
        return next(iter(self.omni_cameras), None)

    @property
    def mirror_camera(self) -> OmniCameraDescription | None:
        """The camera with a mirror, which shows the robot itself."""
        return next((omni for omni in self.omni_cameras if omni.camera.has_mirror), None)

    def robot_from_omni(
        self, omni: OmniCameraDescription, joint_angles_rad: Mapping[str, float]
    ) -> Pose:
        """Pose of an omnidirectional camera's mirror frame on the chassis."""
        return self.robot_from_part(omni.parent, joint_angles_rad) @ omni.robot_from_mirror

    def viewpoint_height_m(self, omni: OmniCameraDescription) -> float:
        """Height of a camera's effective viewpoint above the floor, joints at 0, robot upright."""
        # z points down: a mirror above the chassis origin has a negative z.
        z = float(self.robot_from_omni(omni, {}).translation[2])
        return self.drive.ride_height_m - z

    @property
    def max_viewpoint_height_m(self) -> float:
        """Height of the highest effective viewpoint; 0 without an omnidirectional camera."""
        return max(map(self.viewpoint_height_m, self.omni_cameras), default=0.0)
