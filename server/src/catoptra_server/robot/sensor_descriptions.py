"""What a robot file says of each kind of sensor: frozen data in SI units.

Noises are standard deviations of Gaussian noise, drawn anew for each reading unless stated.
is_timed: whether readings that UT2004 sends without a time carry one in UDK.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from catoptra_server.robot.mount import Mount


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
    mount: Mount = field(default_factory=Mount)
    has_timestamp: bool = True


@dataclass(frozen=True, slots=True)
class GroundTruthDescription:
    """The true pose, printed with `decimals`: of the robot, or of where the sensor is mounted."""

    name: str
    interval_s: float
    decimals: int
    mount: Mount = field(default_factory=Mount)
    is_chassis_pose: bool = True


@dataclass(frozen=True, slots=True)
class RangeScannerDescription:
    """A laser scanner such as the SICK LMS200. noise: metres.

    It turns in yaw, in its mount's x-y plane; in pitch, in the x-z plane; in both, or not at all.
    """

    name: str
    interval_s: float
    mount: Mount
    fov_rad: float
    resolution_rad: float
    min_range_m: float
    max_range_m: float
    noise_m: float = 0.0
    is_panning: bool = True
    is_tilting: bool = False


# A level sonar's cone grazes the floor at 80 degrees or more from its normal. All captures of real
# servers show ranges beyond that place: a floor brings no echo, walls met obliquely do.
MAX_ECHO_INCIDENCE_RAD = math.radians(75.0)


@dataclass(frozen=True, slots=True)
class SonarDescription:
    """One sonar that looks along its mount's x. beam_rad: the cone's full angle. noise: metres.

    The cone is sampled by its axis and `cones` rings of `rays` rays. A ray off the axis that meets
    a surface at more than `max_incidence_rad` from its normal brings no echo.
    """

    name: str
    interval_s: float
    mount: Mount
    beam_rad: float
    min_range_m: float
    max_range_m: float
    noise_m: float = 0.0
    num_cones: int = 3
    rays_per_cone: int = 8
    max_incidence_rad: float = MAX_ECHO_INCIDENCE_RAD


@dataclass(frozen=True, slots=True)
class InsDescription:
    """An inertial navigation system.

    noise: metres and radians. Drifting, its errors are random walks that have this standard
    deviation after 1 s, standing or not; else it is noise of each reading alone. precision:
    drifting, each metre adds up to half of 1 / precision metres to x and y, and each radian up to
    half of 1 / precision^2 radians to yaw, the same all a robot's life; 0 = nothing.
    """

    name: str
    interval_s: float
    mount: Mount
    noise: float = 0.0
    is_drifting: bool = True
    precision: float = 0.0
    has_timestamp: bool = False


@dataclass(frozen=True, slots=True)
class EncoderDescription:
    """Counts ticks of what turns: `shaft` is left, right, or the name of a package's link.

    noise: radians of the angle before it is counted.
    """

    name: str
    interval_s: float
    mount: Mount
    shaft: str
    resolution_rad: float
    noise_rad: float = 0.0
    has_timestamp: bool = True


@dataclass(frozen=True, slots=True)
class TachometerDescription:
    """Tells spin and turned angle of so many driven wheels, right and left in turn, front first."""

    name: str
    interval_s: float
    mount: Mount
    num_wheels: int = 4


@dataclass(frozen=True, slots=True)
class TouchDescription:
    """A contact switch of a diameter at its mount, which looks along the mount's x."""

    name: str
    interval_s: float
    mount: Mount
    diameter_m: float
    has_timestamp: bool = True


@dataclass(frozen=True, slots=True)
class RfidDescription:
    """A reader of all tags within a range, walls or not."""

    name: str
    interval_s: float
    mount: Mount
    max_range_m: float


@dataclass(frozen=True, slots=True)
class VictimSensorDescription:
    """Finds victims in its field of view around the mount's x, in sight and within a range."""

    name: str
    interval_s: float
    mount: Mount
    fov_rad: float
    max_range_m: float


@dataclass(frozen=True, slots=True)
class GpsDescription:
    """A GPS receiver under the open sky. noise: metres, north and east."""

    name: str
    interval_s: float
    mount: Mount
    noise_m: float = 0.0
    has_timestamp: bool = False


SensorDescription = (
    SonarDescription
    | RangeScannerDescription
    | InsDescription
    | OdometryDescription
    | EncoderDescription
    | TachometerDescription
    | TouchDescription
    | RfidDescription
    | VictimSensorDescription
    | GroundTruthDescription
    | GpsDescription
)
