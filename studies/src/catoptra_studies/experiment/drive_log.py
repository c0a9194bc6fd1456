"""One drive round the field over the sockets: poses, odometry and landmark measurements.

The log has everything that a filter needs, so that filters can be compared on the same drive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_client.control_connection import ServerAddress
from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.landmarks import (
    ColourClassifier,
    Detector,
    Viewpoint,
    detect,
    make_detector,
)
from catoptra_client.localization import OdometryPose
from catoptra_client.robot_client import RobotClient
from catoptra_client.training_frames import ROBOT_CLASS
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_protocol.usarsim.reports import VehicleGeometry
from catoptra_studies.experiment.experiment_setups import (
    ExperimentSetup,
    MeasurementSource,
)
from catoptra_studies.experiment.landmark_measurement import (
    LandmarkMeasurement,
    MeasurementFunction,
    manual_measurement,
    manual_noise_sources,
    measurements_in_range,
)
from catoptra_studies.experiment.route import Waypoint
from catoptra_studies.experiment.waypoint_controller import Chassis, wheel_command_towards

Positions = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class DriveStep:
    """Truth and measurements after one step."""

    truth: Waypoint
    odometry: OdometryPose
    measurements: tuple[LandmarkMeasurement, ...]


@dataclass(frozen=True, slots=True)
class DriveLog:
    """A whole drive."""

    setup: str
    """Name of the set-up."""

    run: int
    """Number of the run, from 0."""

    steps: tuple[DriveStep, ...]
    """Steps of the route; the first is the start, without measurements."""


# Receives the robot and each step of its drive, the start first, while the clock stands.
StepCallback = Callable[[RobotClient, DriveStep], None]


def log_drive(
    setup: ExperimentSetup,
    run: int,
    address: ServerAddress,
    *,
    seed: int,
    landmarks: tuple[Landmark, ...],
    classifier: ColourClassifier | None,
    on_step: StepCallback,
) -> DriveLog:
    """Drive one set-up on a lockstep server.

    Args:
        setup: Route and source of measurements.
        run: Number of the run.
        address: Server to connect to.
        seed: Seed of the experiment, for the noise of manual measurements; the server has it, too.
        landmarks: Landmarks of the field.
        classifier: Classifier for set-ups that detect landmarks in frames.
        on_step: Called after the start and each step.

    Raises:
        CatoptraError: The set-up detects landmarks and there is no classifier.
    """
    start = setup.route[0]
    # All noise of a drive follows from the seed and this name, in the server and here.
    robot_name = f"Run{run}"
    with RobotClient.connect(address.host, address.control_port) as robot:
        robot.spawn(
            ROBOT_CLASS,
            name=robot_name,
            location_m=(start.x_m, start.y_m, 0.0),
            rotation_rad=(0.0, 0.0, start.yaw_rad),
        )
        camera, height_m = robot.get_camera_and_height()
        with ImageClient.connect(address.host, address.image_port) as images:
            if setup.measurement_source is MeasurementSource.DETECTOR:
                if classifier is None:
                    raise CatoptraError(f"set-up {setup.name} detects landmarks: train first")
                viewpoint = Viewpoint(height_m)
                detector = make_detector(
                    camera, classifier, landmarks=landmarks, viewpoint=viewpoint
                )
                measure = _detector_measurement(images, detector)
            else:
                noise = manual_noise_sources(seed, robot_name, landmarks)
                measure = manual_measurement(setup, camera, height_m, landmarks, noise)
            return DriveLog(setup.name, run, drive_route(setup, robot, measure, on_step))


def drive_route(
    setup: ExperimentSetup,
    robot: RobotClient,
    measure: MeasurementFunction,
    on_step: StepCallback = lambda robot, step: None,
) -> tuple[DriveStep, ...]:
    """Drive a spawned robot along the set-up's route and measure after every step."""
    chassis = read_chassis(robot)
    steps = [DriveStep(read_true_pose(robot), read_odometry_pose(robot), ())]
    on_step(robot, steps[0])
    # Step k of the route is row k of every result, and row 0 the start.
    for target in setup.route[1:]:
        # Steered by the true pose, so that slip does not add up: the robots of the paper were
        # driven by people who saw them.
        command = wheel_command_towards(target, read_true_pose(robot), chassis)
        robot.drive(command.left_rad_s, command.right_rad_s)
        robot.step(command.duration_s)
        truth = read_true_pose(robot)
        steps.append(DriveStep(truth, read_odometry_pose(robot), measure(truth)))
        on_step(robot, steps[-1])
    return tuple(steps)


def _detector_measurement(images: ImageClient, detector: Detector) -> MeasurementFunction:
    """Measurement by detecting landmarks in a new frame; the true pose is not used."""

    def measure(truth: Waypoint) -> tuple[LandmarkMeasurement, ...]:
        return measurements_in_range(detect(detector, images.get_frame().rgb))

    return measure


def read_true_pose(robot: RobotClient) -> Waypoint:
    """Latest true pose of a robot.

    Raises:
        CatoptraError: The robot has no GroundTruth sensor.
    """
    reading = robot.ground_truth
    if reading is None:
        raise CatoptraError("the robot has no GroundTruth sensor: the experiment needs one")
    x, y, _ = reading.location_m
    return Waypoint(x, y, wrap_angle(reading.rotation_rad[2]))


def read_odometry_pose(robot: RobotClient) -> OdometryPose:
    """Latest odometry of a robot.

    Raises:
        CatoptraError: The robot has no Odometry sensor.
    """
    reading = robot.odometry
    if reading is None:
        raise CatoptraError("the robot has no Odometry sensor: the experiment needs one")
    return OdometryPose(reading.x_m, reading.y_m, reading.yaw_rad)


def read_chassis(robot: RobotClient) -> Chassis:
    """Dimensions of a robot, from its server."""
    geometry = robot.get_geometry("Robot")
    assert isinstance(geometry, VehicleGeometry), "GETGEO Robot has a vehicle's reply"
    speed = robot.get_configuration("Robot").get("MaxSpeed")
    return Chassis(geometry.wheel_radius_m, geometry.wheel_separation_m, float(speed or 0.0))


def true_positions(drive_log: DriveLog) -> Positions:
    """(steps + 1, 2) true positions in metres."""
    return np.array([(step.truth.x_m, step.truth.y_m) for step in drive_log.steps])
