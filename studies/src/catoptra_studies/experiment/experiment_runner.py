"""Work of the experiment without any output: train, drive every run, replay the filters.

Each set-up has a server: a process that ends with the drives, or one that runs elsewhere, such as
in another container. The latter must have been started as by `run_server`: lockstep, raw images,
the set-up's robot and the experiment's seed. Then the logs of the drives are the same.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from catoptra_client.bundled_landmarks import find_landmark_file
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
from catoptra_client.localization import make_landmark_map
from catoptra_client.robot_client import RobotClient
from catoptra_client.server_process import PageCallback, run_server
from catoptra_client.training_frames import capture_training_frames
from catoptra_protocol.errors import ConnectionLostError, DomainError
from catoptra_protocol.landmarks import Landmark, read_landmarks
from catoptra_studies.experiment.drive_log import DriveLog, DriveStep, log_drive, spawn_robot
from catoptra_studies.experiment.experiment_setups import (
    FILTERS,
    PAPER_FILTER,
    ExperimentSetup,
    MeasurementSource,
)
from catoptra_studies.experiment.localization_filter import (
    NOTE_NAME,
    FilterRun,
    FilterStep,
    advance_filter,
    begin_filter,
    note_from_filter_step,
    replay_filter,
    summarize_filter_steps,
)
from catoptra_studies.experiment.route import Waypoint

_FIELD = "four_legged_2006"
# The one that the paper's text discusses; it runs with the drive, the others after it.
PUBLISHED_FILTER = PAPER_FILTER


@dataclass(frozen=True, slots=True)
class ExperimentConfig:
    """Extent of the experiment, and servers."""

    config_folder: Path | None
    """Folder with robots/, worlds/ and landmarks/; None uses the files bundled with server and
    client."""

    output_folder: Path
    setups: tuple[ExperimentSetup, ...]

    num_runs: int
    """Drives for each set-up, numbered from 0; the number keys the noise together with `seed`."""

    seed: int
    """Seed of all random numbers: servers, manual measurements, training poses."""

    num_training_frames: int

    server_arguments: tuple[str, ...] = ()
    """Arguments for servers that are started here."""

    remote_servers: Mapping[str, ServerAddress] = field(default_factory=dict)
    """Running servers by set-up; servers of all other set-ups are started as processes."""

    other_world: tuple[Path, tuple[Landmark, ...]] | None = None
    """World file, by an absolute path, and landmarks in place of the field's."""

    timeout_s: float = 60.0
    """Longest wait for a remote server, and for figures drawn by another program."""

    @property
    def field_world_file(self) -> Path:
        """World file of the field."""
        if self.other_world is not None:
            return self.other_world[0]
        return self.find_file("worlds", f"{_FIELD}.ini")

    @property
    def landmarks(self) -> tuple[Landmark, ...]:
        """Landmarks of the field, from the file that the world also refers to."""
        if self.other_world is not None:
            return self.other_world[1]
        if self.config_folder is None:
            return read_landmarks(find_landmark_file(_FIELD))
        return read_landmarks(self.config_folder / "landmarks" / f"{_FIELD}.csv")

    def find_file(self, kind: str, name: str) -> Path:
        """Robot or world file in a folder, `robots` or `worlds`; an absolute path as given."""
        if Path(name).is_absolute():
            return Path(name)
        if self.config_folder is None:
            # The server resolves names without suffix to bundled files.
            return Path(Path(name).stem)
        return self.config_folder / kind / name


@dataclass(frozen=True, slots=True)
class SetupResult:
    """All drives of one set-up."""

    setup: ExperimentSetup
    drive_logs: tuple[DriveLog, ...]

    filter_runs: dict[str, tuple[FilterRun, ...]]
    """Runs over all drives by the filter's name."""


def run_setup(
    config: ExperimentConfig,
    setup: ExperimentSetup,
    classifier: ColourClassifier | None,
    *,
    on_step: Callable[[], None] = lambda: None,
    on_page: PageCallback | None = None,
) -> SetupResult:
    """Drive every run on one server, then replay every filter over the logs.

    Args:
        config: Number of drives and servers.
        setup: Set-up to drive.
        classifier: Classifier, for a set-up that detects landmarks.
        on_step: Called after each step.
        on_page: Receives the link of the server's live page; None serves no page.
    """
    landmark_map = make_landmark_map(config.landmarks)
    with open_server(config, setup, on_page) as address:
        # One server for all runs: noise follows the robot's name, not the order of connections.
        drives = [
            _drive_and_publish(config, setup, run, address, classifier, on_step)
            for run in range(config.num_runs)
        ]
    drive_logs = tuple(drive_log for drive_log, _ in drives)
    filter_runs = {
        settings.name: tuple(
            replay_filter(log, setup, settings, landmark_map) for log in drive_logs
        )
        for settings in FILTERS
        if settings is not PUBLISHED_FILTER
    }
    filter_runs[PUBLISHED_FILTER.name] = tuple(filter_run for _, filter_run in drives)
    return SetupResult(setup, drive_logs, filter_runs)


def _drive_and_publish(
    config: ExperimentConfig,
    setup: ExperimentSetup,
    run: int,
    address: ServerAddress,
    classifier: ColourClassifier | None,
    on_step: Callable[[], None],
) -> tuple[DriveLog, FilterRun]:
    """Drive one run; one filter runs along, and the robot's viewers see the belief."""
    landmark_map = make_landmark_map(config.landmarks)
    filter_steps: list[FilterStep] = []

    def follow(robot: RobotClient, step: DriveStep) -> None:
        filter_steps.append(
            advance_filter(filter_steps[-1], step, PUBLISHED_FILTER, landmark_map)
            if filter_steps
            else begin_filter(
                step, PUBLISHED_FILTER, heading_error_rad=setup.initial_heading_error_rad
            )
        )
        robot.publish(NOTE_NAME, note_from_filter_step(filter_steps[-1]))
        on_step()

    drive_log = log_drive(
        setup,
        run,
        address,
        seed=config.seed,
        landmarks=config.landmarks,
        classifier=classifier,
        on_step=follow,
    )
    return drive_log, summarize_filter_steps(filter_steps, PUBLISHED_FILTER, run=run)


def open_server(
    config: ExperimentConfig, setup: ExperimentSetup, on_page: PageCallback | None = None
) -> AbstractContextManager[ServerAddress]:
    """Server of a set-up: the remote one, otherwise a process that ends with the block."""
    # A server loads one robot file, and a set-up is a robot file: so each has a server.
    if setup.name in config.remote_servers:
        address = config.remote_servers[setup.name]
        _wait_for_server(address, config.timeout_s)
        return nullcontext(address)
    return run_server(
        config.find_file("robots", setup.robot_file),
        config.field_world_file,
        seed=config.seed,
        log_file=config.output_folder / f"server_{setup.name}.log",
        extra_arguments=config.server_arguments,
        on_page=on_page,
    )


_DEFAULT_CONTROL_PORT = 3000
_DEFAULT_IMAGE_PORT = 5003
_SERVER_PATTERN = re.compile(r"(\w+)=([^\s:=]+)(?::(\d{1,5}))?(?::(\d{1,5}))?", re.ASCII)
# A container's name resolves a moment after the start, so early attempts fail at once.
_POLL_INTERVAL_S = 0.2


def parse_server_address(text: str) -> tuple[str, ServerAddress]:
    """Parse `sim=host`, `sim=host:3000` or `sim=host:3000:5003`.

    Returns:
        The name of the set-up and the address.

    Raises:
        DomainError: The text has another form.
    """
    match = _SERVER_PATTERN.fullmatch(text)
    if match is None:
        raise DomainError(f"a server is NAME=HOST[:CONTROL[:IMAGE]], sim=localhost, not {text!r}")
    control, image = match[3] or _DEFAULT_CONTROL_PORT, match[4] or _DEFAULT_IMAGE_PORT
    return match[1], ServerAddress(match[2], int(control), int(image))


def _wait_for_server(address: ServerAddress, timeout_s: float) -> None:
    """Wait until a server's control port accepts a connection and sends the greeting.

    Raises:
        ConnectionLostError: The server did not accept a connection in time.
    """
    deadline_s = time.monotonic() + timeout_s
    while True:
        try:
            # Waits for the greeting: a proxy may accept before the server behind listens.
            RobotClient.connect(address.host, address.control_port).close()
            return
        except ConnectionLostError:
            if time.monotonic() >= deadline_s:
                raise
        time.sleep(_POLL_INTERVAL_S)


# From here two beacons and a goal are within 2.5 m.
_SNAPSHOT_POSE = Waypoint(1.0, -0.6, 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class DetectorSnapshot:
    """One frame received over TCP, with all stages of the detection."""

    rgb: UInt8Array
    """(h, w, 3) image."""

    detector: Detector
    stages: DetectionStages


def train_classifier(
    config: ExperimentConfig, *, on_frame: Callable[[], None] = lambda: None
) -> tuple[ColourClassifier, DetectorSnapshot]:
    """Train a classifier from a server's frames and write classifier.npz.

    Args:
        config: Needs a set-up that detects landmarks.
        on_frame: Called after each frame.

    Returns:
        The classifier, and an example of detection.
    """
    setup = next(s for s in config.setups if s.measurement_source is MeasurementSource.DETECTOR)
    with open_server(config, setup) as address:
        classifier = train_on_server(config, address, on_frame=on_frame)
        # For the user, too: catoptra-client bearings --classifier shows detections live.
        save_classifier(classifier, config.output_folder / "classifier.npz")
        return classifier, _take_snapshot(config, address, classifier)


def train_on_server(
    config: ExperimentConfig, address: ServerAddress, *, on_frame: Callable[[], None] = lambda: None
) -> ColourClassifier:
    """Train a classifier from the frames of one server."""
    return train(
        capture_training_frames(
            address,
            landmarks=config.landmarks,
            num_frames=config.num_training_frames,
            # Not the seed of the drives: the drives must have other frames than the training.
            seed=config.seed + 1,
            on_frame=on_frame,
        )
    )


def _take_snapshot(
    config: ExperimentConfig, address: ServerAddress, classifier: ColourClassifier
) -> DetectorSnapshot:
    with (
        RobotClient.connect(address.host, address.control_port) as robot,
        ImageClient.connect(address.host, address.image_port) as images,
    ):
        # Without a name: the noise of every drive follows from the robot's name and stays the same.
        spawn_robot(robot, _SNAPSHOT_POSE)
        camera, height_m = robot.get_camera_and_height()
        detector = make_detector(
            camera, classifier, landmarks=config.landmarks, viewpoint=Viewpoint(height_m)
        )
        rgb = images.get_frame().rgb
        return DetectorSnapshot(rgb, detector, detect_with_stages(detector, rgb))
