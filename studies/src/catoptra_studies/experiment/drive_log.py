"""One drive round the field over the sockets: poses, odometry and landmark measurements.

The log has everything that a filter needs, so that filters can be compared on the same drive.
Landmarks are measured by detection in frames, or by hand: the paper's real set-up measured by hand
in recorded frames. Here the robot is simulated, so such a measurement is the truth with noise.

Goals are landmarks by hand only: from pixels a goal's mouth has no range, since its visible part
has another centre. The noise by hand is keyed by seed, run and landmark, and the runs are the
robots Run0, Run1, ..., so that no number depends on the order of connections.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from catoptra_client.control_connection import ServerAddress
from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.landmarks import (
    ColourClassifier,
    Detection,
    Detector,
    Viewpoint,
    detect,
    make_detector,
)
from catoptra_client.landmarks.candidates import range_from_half_angle
from catoptra_client.localization import OdometryPose
from catoptra_client.robot_client import RobotClient
from catoptra_client.training_frames import ROBOT_CLASS
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import Floats, wrap_angle
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.usarsim.reports import VehicleGeometry
from catoptra_studies.experiment.experiment_setups import (
    MAX_RANGE_M,
    ExperimentSetup,
    MeasurementSource,
)
from catoptra_studies.experiment.route import (
    Chassis,
    Waypoint,
    WheelCommand,
    wheel_command_towards,
)


@dataclass(frozen=True, slots=True)
class LandmarkMeasurement:
    """Measurement of one landmark in one step."""

    name: str
    range_m: float

    bearing_rad: float
    """Clockwise from the robot's forward direction."""


# Measure landmarks after a step, from the true pose.
_MeasurementFunction = Callable[[Waypoint], tuple[LandmarkMeasurement, ...]]


def measurements_in_range(detections: Sequence[Detection]) -> tuple[LandmarkMeasurement, ...]:
    """Measurements for a filter: detections with a range, of near landmarks."""
    return tuple(
        LandmarkMeasurement(detection.name, detection.range_m, detection.bearing_rad)
        for detection in detections
        if detection.has_range and detection.range_m <= MAX_RANGE_M
    )


def _named_generator(*names: str) -> np.random.Generator:
    """Philox keyed by names, as the server keys the noise of robots."""
    # SHA-256 and not hash(), which Python salts in each process. NUL separates: no name has one.
    digest = hashlib.sha256("\0".join(names).encode()).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest[:16], "little")))


def manual_measurement(
    setup: ExperimentSetup,
    camera: OmniCamera,
    height_m: float,
    landmarks: tuple[Landmark, ...],
    *,
    seed: int,
    robot_name: str,
) -> _MeasurementFunction:
    """Measurement of the true landmarks with noise, as by hand in recorded frames.

    Args:
        setup: Noise of the measurements.
        camera: Camera with the image in which the noise applies.
        height_m: Height of the viewpoint above the floor.
        landmarks: Landmarks of the field.
        seed: Seed of the experiment.
        robot_name: Name of the robot, which numbers the run.
    """
    # Independent for each landmark.
    generators = [_named_generator(str(seed), robot_name, one.name) for one in landmarks]

    def measure(truth: Waypoint) -> tuple[LandmarkMeasurement, ...]:
        measurements = (
            _measure_manually(setup, camera, height_m, truth, landmark, generator)
            for landmark, generator in zip(landmarks, generators, strict=True)
        )
        return tuple(m for m in measurements if m is not None)

    return measure


def _measure_manually(
    setup: ExperimentSetup,
    camera: OmniCamera,
    height_m: float,
    truth: Waypoint,
    landmark: Landmark,
    generator: np.random.Generator,
) -> LandmarkMeasurement | None:
    """Measure a landmark's foot with noise on image radius and bearing.

    None where the landmark is too far, or where the noise leaves no range.
    """
    # Drawn in every step, in range or not: a step's noise then depends on the number of the step.
    radial, angular = generator.standard_normal(2)
    # The foot on the floor: the distance follows from the image radius alone.
    dx, dy = landmark.x_m - truth.x_m, landmark.y_m - truth.y_m
    range_m = math.hypot(dx, dy)
    if range_m > MAX_RANGE_M:
        return None
    # tan(theta/2) = sin / (1 + cos), with sin = range / distance and cos = height / distance.
    true_t = np.array(range_m / (math.hypot(range_m, height_m) + height_m))
    # r_i / h of the foot, by the camera model where the paper has Eq. 2.
    ratio = float(camera.projection.radius_ratio_from_t(true_t))
    ratio += float(radial) * setup.manual_sigma_px / camera.scale_px
    bearing_rad = wrap_angle(math.atan2(dy, dx) - truth.yaw_rad)
    bearing_rad = wrap_angle(bearing_rad + float(angular) * setup.manual_sigma_rad)
    # Noise may push a near foot across the image's centre, where no radius is.
    if ratio < 0.0:
        return None
    t = float(camera.projection.t_from_radius_ratio(np.array(ratio)))
    measured_m, is_below_horizon = range_from_half_angle(t, drop_m=height_m)
    if not is_below_horizon:
        return None
    return LandmarkMeasurement(landmark.name, measured_m, bearing_rad)


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


# Receives the robot and each step of the drive, the start first, while the clock stands.
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
        seed: Seed of the experiment, for the noise of manual measurements; the server has the same.
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
        spawn_robot(robot, start, robot_name)
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
                measure = manual_measurement(
                    setup, camera, height_m, landmarks, seed=seed, robot_name=robot_name
                )
            return DriveLog(setup.name, run, drive_route(setup, robot, measure, on_step))


def spawn_robot(robot: RobotClient, start: Waypoint, name: str | None = None) -> None:
    """Spawn a robot on the floor, of the class of all robots of the experiment."""
    robot.spawn(
        ROBOT_CLASS,
        name=name,
        location_m=(start.x_m, start.y_m, 0.0),
        rotation_rad=(0.0, 0.0, start.yaw_rad),
    )


def drive_route(
    setup: ExperimentSetup,
    robot: RobotClient,
    measure: _MeasurementFunction,
    on_step: StepCallback = lambda robot, step: None,
    commands: list[WheelCommand] | None = None,
) -> tuple[DriveStep, ...]:
    """Drive a spawned robot along the set-up's route and measure after every step.

    Commands of an earlier drive are repeated; those of the steps beyond are appended to them.
    """
    chassis, commands = read_chassis(robot), [] if commands is None else commands
    steps = [DriveStep(read_true_pose(robot), _read_odometry_pose(robot), ())]
    on_step(robot, steps[0])
    # Step k of the route is row k of every result, and row 0 the start.
    for number, target in enumerate(setup.route[1:]):
        # Steered by the true pose, so that slip does not add up: the robots of the paper were
        # driven by people with a view of the field.
        if number == len(commands):
            commands.append(wheel_command_towards(target, read_true_pose(robot), chassis))
        command = commands[number]
        robot.drive(command.left_rad_s, command.right_rad_s)
        robot.step(command.duration_s)
        truth = read_true_pose(robot)
        steps.append(DriveStep(truth, _read_odometry_pose(robot), measure(truth)))
        on_step(robot, steps[-1])
    return tuple(steps)


def _detector_measurement(images: ImageClient, detector: Detector) -> _MeasurementFunction:
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


def _read_odometry_pose(robot: RobotClient) -> OdometryPose:
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


def true_positions(drive_log: DriveLog) -> Floats:
    """(steps + 1, 2) true positions in metres."""
    return np.array([(step.truth.x_m, step.truth.y_m) for step in drive_log.steps])
