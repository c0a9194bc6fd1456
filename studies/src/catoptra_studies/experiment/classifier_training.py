"""The detector's classifier, trained from a server's frames, and one frame with its detections."""

from __future__ import annotations

from dataclasses import dataclass

from catoptra_client.control_connection import ServerAddress
from catoptra_client.frame_sources.image_client import ImageClient
from catoptra_client.landmarks import (
    ColourClassifier,
    DetectionStages,
    Detector,
    Viewpoint,
    detect_with_stages,
    make_detector,
    save_classifier,
    train,
)
from catoptra_client.landmarks.classifier import UInt8Array
from catoptra_client.robot_client import RobotClient
from catoptra_client.training_frames import ROBOT_CLASS, capture_training_frames
from catoptra_studies.experiment.experiment_runner import (
    ExperimentConfig,
    ProgressCallback,
    open_server,
)
from catoptra_studies.experiment.experiment_setups import MeasurementSource

# Metres and radians: from here two beacons and a goal are within 2.5 m.
_SNAPSHOT_POSE = (1.0, -0.6, 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class DetectorSnapshot:
    """One frame received over TCP, with all stages of its detection."""

    rgb: UInt8Array
    """(h, w, 3) image."""

    detector: Detector
    stages: DetectionStages


def train_classifier(
    config: ExperimentConfig, on_progress: ProgressCallback
) -> tuple[ColourClassifier, DetectorSnapshot]:
    """Train a classifier from a server's frames and save it to classifier.npz.

    Args:
        config: Needs a set-up that detects landmarks.
        on_progress: Called with "train" after each frame.

    Returns:
        The classifier, and an example of its use.
    """
    setup = next(s for s in config.setups if s.measurement_source is MeasurementSource.DETECTOR)
    with open_server(config, setup) as address:
        frames = capture_training_frames(
            address,
            landmarks=config.landmarks,
            num_frames=config.num_training_frames,
            # Not the seed of the drives: their frames must not be those of the training.
            seed=config.seed + 1,
            on_frame=lambda: on_progress("train"),
        )
        classifier = train(frames)
        # For the user, too: catoptra-client bearings --classifier shows its detections live.
        save_classifier(classifier, config.output_folder / "classifier.npz")
        return classifier, _take_snapshot(config, address, classifier)


def _take_snapshot(
    config: ExperimentConfig, address: ServerAddress, classifier: ColourClassifier
) -> DetectorSnapshot:
    x_m, y_m, yaw_rad = _SNAPSHOT_POSE
    with (
        RobotClient.connect(address.host, address.control_port) as robot,
        ImageClient.connect(address.host, address.image_port) as images,
    ):
        # Without a name: the noise of every drive follows from its robot's name and stays the same.
        robot.spawn(ROBOT_CLASS, location_m=(x_m, y_m, 0.0), rotation_rad=(0.0, 0.0, yaw_rad))
        camera, height_m = robot.get_camera_and_height()
        detector = make_detector(
            camera, classifier, landmarks=config.landmarks, viewpoint=Viewpoint(height_m)
        )
        rgb = images.get_frame().rgb
        return DetectorSnapshot(rgb, detector, detect_with_stages(detector, rgb))
