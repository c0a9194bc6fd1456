"""One drive round the field over the sockets, recorded: poses, odometry, landmark measurements.

The record holds all that a filter needs, so that filters can be compared on the very same drive.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.landmarks import (
    ColourClassifier,
    Detector,
    Viewpoint,
    detect,
    make_detector,
)
from catoptra_client.landmarks.ranging import range_from_half_angle
from catoptra_client.localization import OdometryPose
from catoptra_client.robot_client import RobotClient
from catoptra_client.server_address import ServerAddress
from catoptra_client.training_frames import ROBOT_CLASS
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.usarsim.reports import VehicleGeometry
from catoptra_studies.experiment.experiment_setups import (
    MAX_RANGE_M,
    ExperimentSetup,
    MeasurementSource,
)
from catoptra_studies.experiment.route import Waypoint
from catoptra_studies.experiment.waypoint_controller import Chassis, wheel_command_towards


@dataclass(frozen=True, slots=True)
class LandmarkMeasurement:
    """A landmark as it was measured in one step: range in metres, bearing in radians."""

    name: str
    range_m: float
    bearing_rad: float


@dataclass(frozen=True, slots=True)
class DriveStep:
    """What was true and what was measured after one step."""

    truth: Waypoint
    odometry: OdometryPose
    measurements: tuple[LandmarkMeasurement, ...]


@dataclass(frozen=True, slots=True)
class DriveLog:
    """A whole drive. The first step is the start: nothing was driven, nothing looked at."""

    setup: str
    seed: int
    steps: tuple[DriveStep, ...]


MeasurementFunction = Callable[[Waypoint], tuple[LandmarkMeasurement, ...]]


def log_drive(
    setup: ExperimentSetup,
    seed: int,
    address: ServerAddress,
    *,
    landmarks: tuple[Landmark, ...],
    classifier: ColourClassifier | None,
    on_step: Callable[[], None],
) -> DriveLog:
    """Drive one set-up on a lockstep server and return what was measured.

    The server's random numbers follow from its seed and the robot's name, which carries `seed`.
    """
    start = setup.route[0]
    with RobotClient.connect(address.host, address.control_port) as robot:
        robot.spawn(
            ROBOT_CLASS,
            name=f"Run{seed}",
            location_m=(start.x_m, start.y_m, 0.0),
            rotation_rad=(0.0, 0.0, start.yaw_rad),
        )
        camera, height_m = robot.get_camera_and_height()
        with ImageClient.connect(address.host, address.image_port) as images:
            if setup.measurement_source is MeasurementSource.DETECTOR:
                if classifier is None:
                    raise CatoptraError(f"set-up {setup.name} looks at pixels: train first")
                viewpoint = Viewpoint(height_m)
                detector = make_detector(
                    camera, classifier, landmarks=landmarks, viewpoint=viewpoint
                )
                look = _detector_measurement(images, detector)
            else:
                generator = np.random.Generator(np.random.Philox(key=seed))
                look = manual_measurement(setup, camera, height_m, landmarks, generator)
            return DriveLog(setup.name, seed, drive_route(setup, robot, look, on_step))


def drive_route(
    setup: ExperimentSetup,
    robot: RobotClient,
    measure: MeasurementFunction,
    on_step: Callable[[], None],
) -> tuple[DriveStep, ...]:
    """Drive a spawned robot along the set-up's route, looking after every step."""
    chassis = _read_chassis(robot)
    steps = [DriveStep(_true_pose(robot), _odometry_pose(robot), ())]
    for target in setup.route[1:]:
        command = wheel_command_towards(target, _true_pose(robot), chassis)
        robot.drive(command.left_rad_s, command.right_rad_s)
        robot.step(command.duration_s)
        truth = _true_pose(robot)
        steps.append(DriveStep(truth, _odometry_pose(robot), measure(truth)))
        on_step()
    return tuple(steps)


def _detector_measurement(images: ImageClient, detector: Detector) -> MeasurementFunction:
    """Return the look that asks for a frame and finds landmarks in its pixels alone."""

    def measure(truth: Waypoint) -> tuple[LandmarkMeasurement, ...]:
        found = detect(detector, images.get_frame().rgb)
        return tuple(
            LandmarkMeasurement(detection.name, detection.range_m, detection.bearing_rad)
            for detection in found
            if detection.has_range and detection.range_m <= MAX_RANGE_M
        )

    return measure


def manual_measurement(
    setup: ExperimentSetup,
    camera: OmniCamera,
    height_m: float,
    landmarks: tuple[Landmark, ...],
    generator: np.random.Generator,
) -> MeasurementFunction:
    """Return the look that measures true landmarks with a pixel's noise, as a person would."""

    def measure(truth: Waypoint) -> tuple[LandmarkMeasurement, ...]:
        measured = (
            _measure_manually(setup, camera, height_m, truth, m, generator) for m in landmarks
        )
        return tuple(seen for seen in measured if seen is not None)

    return measure


def _measure_manually(
    setup: ExperimentSetup,
    camera: OmniCamera,
    height_m: float,
    truth: Waypoint,
    landmark: Landmark,
    generator: np.random.Generator,
) -> LandmarkMeasurement | None:
    """Return a landmark's foot with noise on its image radius and bearing.

    None if it is too far, or if the noise leaves no range.
    Two numbers are drawn for every landmark, seen or not, so that one does not shift another's.
    """
    radial, angular = generator.standard_normal(2)
    dx, dy = landmark.x_m - truth.x_m, landmark.y_m - truth.y_m
    range_m = math.hypot(dx, dy)
    if range_m > MAX_RANGE_M:
        return None
    ratio = _floor_radius_ratio(camera, range_m, height_m)
    ratio += float(radial) * setup.manual_sigma_px / camera.horizon_radius_px
    bearing = wrap_angle(math.atan2(dy, dx) - truth.yaw_rad)
    bearing = wrap_angle(bearing + float(angular) * setup.manual_sigma_rad)
    if ratio < 0.0:
        return None
    t = float(camera.mirror.t_from_radius_ratio(np.array(ratio)))
    measured_m, below = range_from_half_angle(t, drop_m=height_m)
    return LandmarkMeasurement(landmark.name, measured_m, bearing) if below else None


def _floor_radius_ratio(camera: OmniCamera, range_m: float, height_m: float) -> float:
    """Return r_i / h of a point on the floor: Eq. 2's place, by the mirror's own law."""
    t = np.array(range_m / (math.hypot(range_m, height_m) + height_m))
    return float(camera.mirror.radius_ratio_from_t(t))


def _true_pose(robot: RobotClient) -> Waypoint:
    reading = robot.ground_truth
    if reading is None:
        raise CatoptraError("the robot has no GroundTruth sensor: the experiment needs one")
    x, y, _ = reading.location_m
    return Waypoint(x, y, wrap_angle(reading.rotation_rad[2]))


def _odometry_pose(robot: RobotClient) -> OdometryPose:
    reading = robot.odometry
    if reading is None:
        raise CatoptraError("the robot has no Odometry sensor: the experiment needs one")
    return OdometryPose(reading.x_m, reading.y_m, reading.yaw_rad)


def _read_chassis(robot: RobotClient) -> Chassis:
    geometry = robot.get_geometry("Robot")
    assert isinstance(geometry, VehicleGeometry), "GETGEO Robot is answered by a vehicle"
    speed = robot.get_configuration("Robot").get("MaxSpeed")
    return Chassis(geometry.wheel_radius_m, geometry.wheel_separation_m, float(speed or 0.0))


Positions = npt.NDArray[np.float64]


def true_positions(drive_log: DriveLog) -> Positions:
    """Return the (steps + 1, 2) true positions in metres."""
    return np.array([(step.truth.x_m, step.truth.y_m) for step in drive_log.steps])
