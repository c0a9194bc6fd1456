"""One drive round the field over the sockets, recorded: poses, odometry, landmark measurements.

The record holds all that a filter needs, so that filters can be compared on the very same drive.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_client.experiment.operator import Chassis, command_towards
from catoptra_client.experiment.route import Waypoint
from catoptra_client.experiment.server_process import ServerAddress
from catoptra_client.experiment.setups import LONGEST_RANGE_M, Setup, Sighting
from catoptra_client.images import ImageStream
from catoptra_client.landmarks import (
    ColourClassifier,
    Detector,
    Viewpoint,
    detect,
    make_detector,
)
from catoptra_client.landmarks.ranging import range_from_half_angle
from catoptra_client.localization import OdometryPose
from catoptra_client.robot import Robot
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_protocol.wire.reports import VehicleGeometry

ROBOT_CLASS = "USARBot.OmniP2AT"


@dataclass(frozen=True, slots=True)
class Seen:
    """A landmark as it was measured in one step: range in metres, bearing in radians."""

    name: str
    range_m: float
    bearing_rad: float


@dataclass(frozen=True, slots=True)
class Step:
    """What was true and what was measured after one step."""

    truth: Waypoint
    odometry: OdometryPose
    seen: tuple[Seen, ...]


@dataclass(frozen=True, slots=True)
class Recording:
    """A whole drive. The first step is the start: nothing was driven, nothing looked at."""

    setup: str
    seed: int
    steps: tuple[Step, ...]


Look = Callable[[Waypoint], tuple[Seen, ...]]


def record(
    setup: Setup,
    seed: int,
    address: ServerAddress,
    *,
    landmarks: tuple[Landmark, ...],
    classifier: ColourClassifier | None,
    on_step: Callable[[], None],
) -> Recording:
    """Drive one set-up on a lockstep server and return what was measured.

    The server's random numbers follow from its seed and the robot's name, which carries `seed`.
    """
    start = setup.route[0]
    with Robot.connect(address.host, address.control_port) as robot:
        robot.spawn(
            ROBOT_CLASS,
            name=f"Run{seed}",
            location_m=(start.x_m, start.y_m, 0.0),
            rotation_rad=(0.0, 0.0, start.yaw_rad),
        )
        camera, height_m = robot.camera_and_height()
        with ImageStream.connect(address.host, address.image_port) as images:
            if setup.sighting is Sighting.PIXELS:
                if classifier is None:
                    raise CatoptraError(f"set-up {setup.name} looks at pixels: train first")
                viewpoint = Viewpoint(height_m)
                detector = make_detector(
                    camera, classifier, landmarks=landmarks, viewpoint=viewpoint
                )
                look = _by_pixels(images, detector)
            else:
                generator = np.random.Generator(np.random.Philox(key=seed))
                look = hand_look(setup, camera, height_m, landmarks, generator)
            return Recording(setup.name, seed, driven(setup, robot, look, on_step))


def driven(setup: Setup, robot: Robot, look: Look, on_step: Callable[[], None]) -> tuple[Step, ...]:
    """Drive a spawned robot along the set-up's route, looking after every step."""
    chassis = _chassis(robot)
    steps = [Step(_truth(robot), _odometry(robot), ())]
    for target in setup.route[1:]:
        command = command_towards(target, _truth(robot), chassis)
        robot.drive(command.left_rad_s, command.right_rad_s)
        robot.step(command.duration_s)
        truth = _truth(robot)
        steps.append(Step(truth, _odometry(robot), look(truth)))
        on_step()
    return tuple(steps)


def _by_pixels(images: ImageStream, detector: Detector) -> Look:
    """Return the look that asks for a frame and finds landmarks in its pixels alone."""

    def look(truth: Waypoint) -> tuple[Seen, ...]:
        found = detect(detector, images.frame().rgb)
        return tuple(
            Seen(detection.name, detection.range_m, detection.bearing_rad)
            for detection in found
            if detection.has_range and detection.range_m <= LONGEST_RANGE_M
        )

    return look


def hand_look(
    setup: Setup,
    camera: OmniCamera,
    height_m: float,
    landmarks: tuple[Landmark, ...],
    generator: np.random.Generator,
) -> Look:
    """Return the look that measures true landmarks with a pixel's noise, as a person would."""

    def look(truth: Waypoint) -> tuple[Seen, ...]:
        measured = (
            _measured_by_hand(setup, camera, height_m, truth, m, generator) for m in landmarks
        )
        return tuple(seen for seen in measured if seen is not None)

    return look


def _measured_by_hand(
    setup: Setup,
    camera: OmniCamera,
    height_m: float,
    truth: Waypoint,
    landmark: Landmark,
    generator: np.random.Generator,
) -> Seen | None:
    """Return a landmark's foot with noise on its image radius and bearing.

    None if it is too far, or if the noise leaves no range.
    Two numbers are drawn for every landmark, seen or not, so that one does not shift another's.
    """
    radial, angular = generator.standard_normal(2)
    dx, dy = landmark.x_m - truth.x_m, landmark.y_m - truth.y_m
    range_m = math.hypot(dx, dy)
    if range_m > LONGEST_RANGE_M:
        return None
    ratio = _radius_ratio(camera, range_m, height_m)
    ratio += float(radial) * setup.hand_sigma_px / camera.horizon_radius_px
    bearing = wrap_angle(math.atan2(dy, dx) - truth.yaw_rad)
    bearing = wrap_angle(bearing + float(angular) * setup.hand_sigma_rad)
    if ratio < 0.0:
        return None
    t = float(camera.mirror.t_from_radius_ratio(np.array(ratio)))
    measured_m, below = range_from_half_angle(t, drop_m=height_m)
    return Seen(landmark.name, measured_m, bearing) if below else None


def _radius_ratio(camera: OmniCamera, range_m: float, height_m: float) -> float:
    """Return r_i / h of a point on the floor: Eq. 2's place, by the mirror's own law."""
    t = np.array(range_m / (math.hypot(range_m, height_m) + height_m))
    return float(camera.mirror.radius_ratio_from_t(t))


def _truth(robot: Robot) -> Waypoint:
    reading = robot.ground_truth
    if reading is None:
        raise CatoptraError("the robot has no GroundTruth sensor: the experiment needs one")
    x, y, _ = reading.location_m
    return Waypoint(x, y, wrap_angle(reading.rotation_rad[2]))


def _odometry(robot: Robot) -> OdometryPose:
    reading = robot.odometry
    if reading is None:
        raise CatoptraError("the robot has no Odometry sensor: the experiment needs one")
    return OdometryPose(reading.x_m, reading.y_m, reading.yaw_rad)


def _chassis(robot: Robot) -> Chassis:
    geometry = robot.geometry("Robot")
    assert isinstance(geometry, VehicleGeometry), "GETGEO Robot is answered by a vehicle"
    speed = robot.configuration("Robot").get("MaxSpeed")
    return Chassis(geometry.wheel_radius_m, geometry.wheel_separation_m, float(speed or 0.0))


Positions = npt.NDArray[np.float64]


def true_positions(recording: Recording) -> Positions:
    """Return the (steps + 1, 2) true positions in metres."""
    return np.array([(step.truth.x_m, step.truth.y_m) for step in recording.steps])
