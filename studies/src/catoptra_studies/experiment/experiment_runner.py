"""The work of the experiment, nothing printed: train, drive every seed, run the filters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from catoptra_client.bundled_landmarks import find_landmark_file
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
from catoptra_client.landmarks.histogram import UInt8Array
from catoptra_client.localization import make_landmark_map
from catoptra_client.robot_client import RobotClient
from catoptra_client.server_address import ServerAddress
from catoptra_client.training_frames import ROBOT_CLASS, capture_training_frames
from catoptra_protocol.landmarks import Landmark, read_landmarks
from catoptra_studies.experiment.drive_log import DriveLog, log_drive
from catoptra_studies.experiment.experiment_setups import (
    FILTERS,
    ExperimentSetup,
    MeasurementSource,
)
from catoptra_studies.experiment.filter_replay import FilterRun, replay_filter
from catoptra_studies.experiment.remote_server import wait_for_server
from catoptra_studies.experiment.server_process import run_server

ProgressCallback = Callable[[str], None]

# Where the classifier's view is taken: two beacons and a goal within 2.5 m.
_SNAPSHOT_POSE = (1.0, -0.6, 0.5)


@dataclass(frozen=True, slots=True)
class ExperimentConfig:
    """What to run.

    configs: the folder with robots/, worlds/ and landmarks/; None: those that come with server and
    client. servers: those that run elsewhere, by set-up; the others are started here. timeout_s:
    how long something elsewhere may take to be there.
    """

    config_folder: Path | None
    output_folder: Path
    setups: tuple[ExperimentSetup, ...]
    num_runs: int
    seed: int
    num_training_frames: int
    server_arguments: tuple[str, ...] = ()
    remote_servers: Mapping[str, ServerAddress] = field(default_factory=dict)
    timeout_s: float = 60.0

    @property
    def field_world_file(self) -> Path:
        """Return the world file of the field."""
        return self.world_file("four_legged_2006.ini")

    @property
    def landmarks(self) -> tuple[Landmark, ...]:
        """Return the landmarks: the same file that the world draws."""
        if self.config_folder is None:
            return read_landmarks(find_landmark_file("four_legged_2006"))
        return read_landmarks(self.config_folder / "landmarks" / "four_legged_2006.csv")

    def robot_file(self, name: str) -> Path:
        """Return a robot file; of a shipped one its bare name, by which the server finds it."""
        return (
            Path(Path(name).stem)
            if self.config_folder is None
            else self.config_folder / "robots" / name
        )

    def world_file(self, name: str) -> Path:
        """Return a world file; of a shipped one its bare name."""
        return (
            Path(Path(name).stem)
            if self.config_folder is None
            else self.config_folder / "worlds" / name
        )


@dataclass(frozen=True, slots=True)
class SetupResult:
    """All drives of a set-up, and each filter's traces over them."""

    setup: ExperimentSetup
    drive_logs: tuple[DriveLog, ...]
    filter_runs: dict[str, tuple[FilterRun, ...]]


@dataclass(frozen=True, slots=True, eq=False)
class DetectorSnapshot:
    """One frame as it came over TCP, and what the detector made of it."""

    rgb: UInt8Array
    detector: Detector
    stages: DetectionStages


def train_classifier(
    config: ExperimentConfig, on_progress: ProgressCallback
) -> tuple[ColourClassifier, DetectorSnapshot]:
    """Train from a server's frames, save the classifier; return it with an example of its use."""
    setup = next(s for s in config.setups if s.measurement_source is MeasurementSource.DETECTOR)
    with open_server(config, setup) as address:
        frames = capture_training_frames(
            address,
            landmarks=config.landmarks,
            num_frames=config.num_training_frames,
            seed=config.seed + 1,
            on_frame=lambda: on_progress("train"),
        )
        classifier = train(frames)
        save_classifier(classifier, config.output_folder / "classifier.npz")
        return classifier, _take_snapshot(config, address, classifier)


def _take_snapshot(
    config: ExperimentConfig, address: ServerAddress, classifier: ColourClassifier
) -> DetectorSnapshot:
    x, y, yaw = _SNAPSHOT_POSE
    with (
        RobotClient.connect(address.host, address.control_port) as robot,
        ImageClient.connect(address.host, address.image_port) as images,
    ):
        robot.spawn(ROBOT_CLASS, location_m=(x, y, 0.0), rotation_rad=(0.0, 0.0, yaw))
        camera, height_m = robot.get_camera_and_height()
        detector = make_detector(
            camera, classifier, landmarks=config.landmarks, viewpoint=Viewpoint(height_m)
        )
        frame = images.get_frame().rgb
        return DetectorSnapshot(frame, detector, detect_with_stages(detector, frame))


def run_setup(
    config: ExperimentConfig,
    setup: ExperimentSetup,
    classifier: ColourClassifier | None,
    on_progress: ProgressCallback,
) -> SetupResult:
    """Drive every seed on one server and replay every filter."""
    landmarks = config.landmarks
    with open_server(config, setup) as address:
        recordings = tuple(
            log_drive(
                setup,
                run,
                address,
                landmarks=landmarks,
                classifier=classifier,
                on_step=lambda: on_progress(setup.name),
            )
            for run in range(config.num_runs)
        )
    known = make_landmark_map(landmarks)
    traces = {f.name: tuple(replay_filter(r, setup, f, known) for r in recordings) for f in FILTERS}
    return SetupResult(setup, recordings, traces)


def open_server(
    config: ExperimentConfig, setup: ExperimentSetup
) -> AbstractContextManager[ServerAddress]:
    """Return a set-up's server: the one elsewhere, else a process for the block."""
    if setup.name in config.remote_servers:
        return nullcontext(
            wait_for_server(config.remote_servers[setup.name], timeout_s=config.timeout_s)
        )
    return run_server(
        config.robot_file(setup.robot_file),
        config.field_world_file,
        seed=config.seed,
        log_file=config.output_folder / f"server_{setup.name}.log",
        extra_arguments=config.server_arguments,
    )
