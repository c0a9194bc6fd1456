"""A drive as a film: what was true, what odometry said, and every frame as it came over TCP.

Which landmarks a frame shows is asked of the stream. What detectors make of the same film can then
be compared, frame by frame.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.frame_sources.stream.landmark_projections import LandmarkProjection
from catoptra_client.frame_sources.stream.stream_client import StreamClient
from catoptra_client.landmarks import (
    ColourClassifier,
    Detection,
    Detector,
    Viewpoint,
    detect,
    make_detector,
)
from catoptra_client.landmarks.histogram import UInt8Array
from catoptra_client.robot_client import RobotClient
from catoptra_client.server_address import ServerAddress
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_studies.experiment.drive_log import (
    DriveLog,
    LandmarkMeasurement,
    drive_route,
)
from catoptra_studies.experiment.experiment_setups import MAX_RANGE_M, ExperimentSetup
from catoptra_studies.experiment.route import Waypoint

# Two servers and what else the machine does may keep a frame waiting: a study is not lost by that.
_TIMEOUT_S = 60.0


@dataclass(frozen=True, slots=True, eq=False)
class LabelledFrame:
    """A (h, w, 3) frame, and what geometry says of the landmarks in it."""

    rgb: UInt8Array
    landmarks: tuple[LandmarkProjection, ...]


@dataclass(frozen=True, slots=True, eq=False)
class RecordedDrive:
    """A drive whose steps have seen nothing yet, and a shot for each step after the start."""

    log: DriveLog
    frames: tuple[LabelledFrame, ...]
    camera: OmniCamera
    height_m: float


def record_drive(
    setup: ExperimentSetup, seed: int, address: ServerAddress, *, on_step: Callable[[], None]
) -> RecordedDrive:
    """Drive a set-up's route on a lockstep server and keep every frame."""
    if address.stream_port is None:
        raise CatoptraError("a film needs the server's stream: it says what can be seen")
    start, name, shots = setup.route[0], f"Run{seed}", list[LabelledFrame]()
    with (
        RobotClient.connect(address.host, address.control_port, _TIMEOUT_S) as robot,
        ImageClient.connect(address.host, address.image_port, _TIMEOUT_S) as images,
        StreamClient.connect(address.host, address.stream_port, _TIMEOUT_S) as stream,
    ):
        robot.spawn(
            name=name,
            location_m=(start.x_m, start.y_m, 0.0),
            rotation_rad=(0.0, 0.0, start.yaw_rad),
        )
        camera, height_m = robot.get_camera_and_height()

        def look(truth: Waypoint) -> tuple[LandmarkMeasurement, ...]:
            shots.append(
                LabelledFrame(images.get_frame().rgb, stream.get_landmark_projections(name))
            )
            return ()

        steps = drive_route(setup, robot, look, on_step)
    return RecordedDrive(DriveLog(setup.name, seed, steps), tuple(shots), camera, height_m)


def make_drive_detector(
    drive: RecordedDrive, classifier: ColourClassifier, landmarks: Sequence[Landmark]
) -> Detector:
    """Return the detector for a film's camera."""
    viewpoint = Viewpoint(drive.height_m)
    return make_detector(drive.camera, classifier, landmarks=landmarks, viewpoint=viewpoint)


def detect_beacons(drive: RecordedDrive, detector: Detector) -> tuple[tuple[Detection, ...], ...]:
    """Return the beacons that a detector finds, with their range, in each shot."""
    return tuple(
        tuple(d for d in detect(detector, shot.rgb) if d.kind == "beacon" and d.has_range)
        for shot in drive.frames
    )


def add_measurements(drive: RecordedDrive, detections: Sequence[Sequence[Detection]]) -> DriveLog:
    """Return the drive as a filter gets it: with what was measured to be near enough."""
    start, *rest = drive.log.steps
    looked = (
        replace(step, measurements=_measurements_in_range(seen))
        for step, seen in zip(rest, detections, strict=True)
    )
    return replace(drive.log, steps=(start, *looked))


def _measurements_in_range(detections: Sequence[Detection]) -> tuple[LandmarkMeasurement, ...]:
    return tuple(
        LandmarkMeasurement(d.name, d.range_m, d.bearing_rad)
        for d in detections
        if d.range_m <= MAX_RANGE_M
    )
