"""A drive recorded with every frame, so that several detectors can be compared on the same images.

The stream reports which landmarks each frame shows: occlusion is computed by the server's geometry
and no matter of colours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from catoptra_client.control_connection import ServerAddress
from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.frame_sources.stream.stream_client import LandmarkProjection, StreamClient
from catoptra_client.landmarks import ColourClassifier, Detection, Viewpoint, detect, make_detector
from catoptra_client.landmarks.classifier import UInt8Array
from catoptra_client.robot_client import RobotClient
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_studies.experiment.drive_log import (
    DriveLog,
    LandmarkMeasurement,
    drive_route,
    measurements_in_range,
    spawn_robot,
)
from catoptra_studies.experiment.experiment_setups import ExperimentSetup
from catoptra_studies.experiment.route import Waypoint

# Two servers and other programs may delay a frame; an hour of drives must not end by that.
_TIMEOUT_S = 60.0


@dataclass(frozen=True, slots=True, eq=False)
class LabelledFrame:
    """One frame with landmarks."""

    rgb: UInt8Array
    """(h, w, 3) image."""

    landmarks: tuple[LandmarkProjection, ...]
    """Projection and visibility of every landmark, by the server's geometry."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedDrive:
    """A drive with frames and without measurements."""

    log: DriveLog

    frames: tuple[LabelledFrame, ...]
    """One frame for each step after the start."""

    camera: OmniCamera

    height_m: float
    """Height of the viewpoint above the floor."""


def record_drive(setup: ExperimentSetup, seed: int, address: ServerAddress) -> RecordedDrive:
    """Drive a set-up's route on a lockstep server and keep every frame.

    Args:
        setup: Route to drive.
        seed: Number of the run; names the robot, and the server's noise follows the name.
        address: Server with a stream.

    Raises:
        CatoptraError: The address has no stream port.
    """
    if address.stream_port is None:
        raise CatoptraError(
            "recording needs the port of the server's stream, which reports visible landmarks"
        )
    start, name, frames = setup.route[0], f"Run{seed}", list[LabelledFrame]()
    with (
        RobotClient.connect(address.host, address.control_port, _TIMEOUT_S) as robot,
        ImageClient.connect(address.host, address.image_port, _TIMEOUT_S) as images,
        StreamClient.connect(address.host, address.stream_port, _TIMEOUT_S) as stream,
    ):
        spawn_robot(robot, start, name)
        camera, height_m = robot.get_camera_and_height()

        def measure(truth: Waypoint) -> tuple[LandmarkMeasurement, ...]:
            # Both requests fall between two steps of the lockstep clock, hence on the same pose.
            rgb = images.get_frame().rgb
            frames.append(LabelledFrame(rgb, stream.get_landmark_projections(name)))
            return ()

        steps = drive_route(setup, robot, measure)
    return RecordedDrive(DriveLog(setup.name, seed, steps), tuple(frames), camera, height_m)


def detect_beacons(
    drive: RecordedDrive, classifier: ColourClassifier, landmarks: Sequence[Landmark]
) -> tuple[tuple[Detection, ...], ...]:
    """Detect the beacons in each frame, leaving out those without a range."""
    viewpoint = Viewpoint(drive.height_m)
    detector = make_detector(drive.camera, classifier, landmarks=landmarks, viewpoint=viewpoint)
    # A filter cannot use a detection without range, so that beacon counts as missed.
    return tuple(
        tuple(
            detection
            for detection in detect(detector, frame.rgb)
            if detection.kind == "beacon" and detection.has_range
        )
        for frame in drive.frames
    )


def add_measurements(drive: RecordedDrive, detections: Sequence[Sequence[Detection]]) -> DriveLog:
    """The drive's log as a filter receives one, with detections within the range in use."""
    start, *rest = drive.log.steps
    # One entry a frame, empty where nothing was detected: a missing one would shift all later ones
    # to wrong steps, so lengths are compared.
    steps = (
        replace(step, measurements=measurements_in_range(found))
        for step, found in zip(rest, detections, strict=True)
    )
    return replace(drive.log, steps=(start, *steps))
