"""Replies about the world: landmarks, start poses, robots, and what a camera sees at a pixel."""

from __future__ import annotations

from typing import ClassVar

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.transform import Transform
from catoptra_protocol.vectors import Vector3


@dataclass(frozen=True, slots=True)
class LandmarkRecord:
    """One landmark with the fields and units of `catoptra_protocol.landmarks.Landmark`."""

    name: str
    kind: str
    x_m: float
    y_m: float
    width_m: float
    depth_m: float
    band_bottom_m: float
    band_top_m: float
    lower_colour: str
    upper_colour: str
    # Not columns of the landmark file, so this is not a Landmark.
    pixel: tuple[float, float] | None = None
    """Projection of the band centre into the requested camera; None outside the image."""
    visible: bool | None = None
    """Whether the pixel lies in the image without an occluder; None without a camera."""


@dataclass(frozen=True, slots=True)
class LandmarksReply:
    """All landmarks of the world, in the world frame."""

    KIND: ClassVar[str] = "landmarks"

    id: int
    landmarks: tuple[LandmarkRecord, ...]
    time_s: float | None = None
    """Simulation time of the projections; None without a camera."""


@dataclass(frozen=True, slots=True)
class StartPoseRecord:
    """One named start pose in the world frame."""

    name: str
    location_m: Vector3
    rotation_rad: Vector3
    """Roll, pitch, yaw."""


@dataclass(frozen=True, slots=True)
class StartPosesReply:
    """All named start poses."""

    KIND: ClassVar[str] = "start_poses"

    id: int
    start_poses: tuple[StartPoseRecord, ...]


@dataclass(frozen=True, slots=True)
class RobotState:
    """One robot in the world frame."""

    name: str
    class_name: str
    world_from_robot: Transform
    """True pose of the chassis frame."""
    world_from_start: Transform
    """Pose at which the robot was spawned, to which odometry is relative."""
    wheel_speeds_rad_s: tuple[float, float]
    """Commanded speeds of the left and the right wheels."""
    shares_control: bool
    """Whether other clients may drive it."""


@dataclass(frozen=True, slots=True)
class NoteRecord:
    """Newest note of one name."""

    name: str
    time_s: float
    """Simulation time of its arrival."""
    text: str
    """A JSON object."""


@dataclass(frozen=True, slots=True)
class StateReply:
    """All robots, and the newest readings and notes of one of them."""

    KIND: ClassVar[str] = "state"

    id: int
    time_s: float
    """Simulation time."""
    robots: tuple[RobotState, ...]
    """In the order of spawning."""
    robot: str
    """Robot of readings and notes; empty if there is none of the requested name."""
    reports: tuple[str, ...]
    """Newest reading of each sensor, as in SensorReports."""
    notes: tuple[NoteRecord, ...]


@dataclass(frozen=True, slots=True)
class PixelReply:
    """What a camera sees at a point of its image."""

    KIND: ClassVar[str] = "pixel"

    id: int
    time_s: float
    """Simulation time."""
    theta_rad: float | None
    """Incidence angle; None outside the camera model's domain, as all below."""
    azimuth_rad: float | None
    """Azimuth in the camera frame, x towards y."""
    range_m: float | None
    """Distance along the ray; None if it meets nothing."""
    object: str
    """Name of the world's item or of the robot that the ray meets; empty for none."""
    bound_px: float | None
    """Bound on the displacement of outlines at this point; None without a bound."""
