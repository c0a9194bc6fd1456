"""The work of the experiment, nothing printed: train, drive every seed, run the filters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from catoptra_client.experiment.recording import ROBOT_CLASS, Recording, record
from catoptra_client.experiment.remote_server import answering
from catoptra_client.experiment.replay import Trace, replay
from catoptra_client.experiment.server_process import ServerAddress, running_server
from catoptra_client.experiment.setups import FILTERS, Setup, Sighting
from catoptra_client.experiment.training_frames import labelled_frames
from catoptra_client.images import ImageStream
from catoptra_client.landmarks import (
    ColourClassifier,
    Detector,
    View,
    Viewpoint,
    look,
    make_detector,
    save_classifier,
    train,
)
from catoptra_client.landmarks.histogram import Bytes
from catoptra_client.localization import landmark_map
from catoptra_client.robot import Robot
from catoptra_client.shipped import landmark_file
from catoptra_protocol.landmarks import Landmark, read_landmarks

Advance = Callable[[str], None]

# Where the classifier's view is taken: two beacons and a goal within 2.5 m.
_VIEW_FROM = (1.0, -0.6, 0.5)


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run.

    configs: the folder with robots/, worlds/ and landmarks/; None: those that come with server and
    client. servers: those that run elsewhere, by set-up; the others are started here. patience_s:
    how long something elsewhere may take to be there.
    """

    configs: Path | None
    output: Path
    setups: tuple[Setup, ...]
    runs: int
    seed: int
    training_frames: int
    server_arguments: tuple[str, ...] = ()
    servers: Mapping[str, ServerAddress] = field(default_factory=dict)
    patience_s: float = 60.0

    @property
    def world(self) -> Path:
        """Return the world file of the field."""
        return self.world_file("four_legged_2006.ini")

    @property
    def landmarks(self) -> tuple[Landmark, ...]:
        """Return the landmarks: the same file that the world draws."""
        if self.configs is None:
            return read_landmarks(landmark_file("four_legged_2006"))
        return read_landmarks(self.configs / "landmarks" / "four_legged_2006.csv")

    def robot_file(self, name: str) -> Path:
        """Return a robot file; of a shipped one its bare name, by which the server finds it."""
        return Path(Path(name).stem) if self.configs is None else self.configs / "robots" / name

    def world_file(self, name: str) -> Path:
        """Return a world file; of a shipped one its bare name."""
        return Path(Path(name).stem) if self.configs is None else self.configs / "worlds" / name


@dataclass(frozen=True, slots=True)
class SetupResult:
    """All drives of a set-up, and each filter's traces over them."""

    setup: Setup
    recordings: tuple[Recording, ...]
    traces: dict[str, tuple[Trace, ...]]


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """One frame as it came over TCP, and what the detector made of it."""

    frame: Bytes
    detector: Detector
    view: View


def train_classifier(plan: Plan, advance: Advance) -> tuple[ColourClassifier, Snapshot]:
    """Train from a server's frames, save the classifier; return it with an example of its use."""
    setup = next(s for s in plan.setups if s.sighting is Sighting.PIXELS)
    with server_for(plan, setup) as address:
        frames = labelled_frames(
            address,
            landmarks=plan.landmarks,
            count=plan.training_frames,
            seed=plan.seed + 1,
            on_frame=lambda: advance("train"),
        )
        classifier = train(frames)
        save_classifier(classifier, plan.output / "classifier.npz")
        return classifier, _snapshot(plan, address, classifier)


def _snapshot(plan: Plan, address: ServerAddress, classifier: ColourClassifier) -> Snapshot:
    x, y, yaw = _VIEW_FROM
    with (
        Robot.connect(address.host, address.control_port) as robot,
        ImageStream.connect(address.host, address.image_port) as images,
    ):
        robot.spawn(ROBOT_CLASS, location_m=(x, y, 0.0), rotation_rad=(0.0, 0.0, yaw))
        camera, height_m = robot.camera_and_height()
        detector = make_detector(
            camera, classifier, landmarks=plan.landmarks, viewpoint=Viewpoint(height_m)
        )
        frame = images.frame().rgb
        return Snapshot(frame, detector, look(detector, frame))


def run_setup(
    plan: Plan, setup: Setup, classifier: ColourClassifier | None, advance: Advance
) -> SetupResult:
    """Drive every seed on one server and replay every filter."""
    landmarks = plan.landmarks
    with server_for(plan, setup) as address:
        recordings = tuple(
            record(
                setup,
                run,
                address,
                landmarks=landmarks,
                classifier=classifier,
                on_step=lambda: advance(setup.name),
            )
            for run in range(plan.runs)
        )
    known = landmark_map(landmarks)
    traces = {f.name: tuple(replay(r, setup, f, known) for r in recordings) for f in FILTERS}
    return SetupResult(setup, recordings, traces)


def server_for(plan: Plan, setup: Setup) -> AbstractContextManager[ServerAddress]:
    """Return a set-up's server: the one elsewhere, else a process for the block."""
    if setup.name in plan.servers:
        return nullcontext(answering(plan.servers[setup.name], patience_s=plan.patience_s))
    return running_server(
        plan.robot_file(setup.robot_file),
        plan.world,
        seed=plan.seed,
        log=plan.output / f"server_{setup.name}.log",
        extra=plan.server_arguments,
    )
