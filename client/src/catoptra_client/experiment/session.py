"""The work of the experiment, nothing printed: train, drive every seed, filter, draw, report."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from catoptra_client.experiment.claims import paper_claims
from catoptra_client.experiment.ensemble import summary, typical
from catoptra_client.experiment.measurements import measurement_figures
from catoptra_client.experiment.pictures.classifier_view import draw_classifier_view
from catoptra_client.experiment.pictures.errors import draw_ensemble, draw_errors
from catoptra_client.experiment.pictures.trajectories import draw_trajectories
from catoptra_client.experiment.recording import ROBOT_CLASS, Recording, record
from catoptra_client.experiment.replay import Trace, replay
from catoptra_client.experiment.report import Picture, write_report
from catoptra_client.experiment.server_process import ServerAddress, running_server
from catoptra_client.experiment.setups import FILTERS, PAPER_FILTER, Setup, Sighting
from catoptra_client.experiment.training_frames import labelled_frames
from catoptra_client.images import ImageStream
from catoptra_client.landmarks import (
    ColourClassifier,
    Viewpoint,
    look,
    make_detector,
    save_classifier,
    train,
)
from catoptra_client.localization import landmark_map
from catoptra_client.robot import Robot
from catoptra_protocol.landmarks import Landmark, read_landmarks

Advance = Callable[[str], None]

# Where the classifier's view is taken: two beacons and a goal within 2.5 m.
_VIEW_FROM = (1.0, -0.6, 0.5)


@dataclass(frozen=True, slots=True)
class Plan:
    """What to run. configs: the folder with robots/, worlds/ and landmarks/."""

    configs: Path
    output: Path
    setups: tuple[Setup, ...]
    runs: int
    seed: int
    training_frames: int
    server_arguments: tuple[str, ...] = ()

    @property
    def world(self) -> Path:
        """Return the world file of the field."""
        return self.configs / "worlds" / "four_legged_2006.ini"

    @property
    def landmarks(self) -> tuple[Landmark, ...]:
        """Return the landmarks: the same file that the world draws."""
        return read_landmarks(self.configs / "landmarks" / "four_legged_2006.csv")

    def robot(self, setup: Setup) -> Path:
        """Return the robot file of a set-up."""
        return self.configs / "robots" / setup.robot_file


@dataclass(frozen=True, slots=True)
class SetupResult:
    """All drives of a set-up, and each filter's traces over them."""

    setup: Setup
    recordings: tuple[Recording, ...]
    traces: dict[str, tuple[Trace, ...]]


def train_classifier(plan: Plan, advance: Advance) -> ColourClassifier:
    """Train from a server's frames, save the classifier, draw what it sees."""
    setup = next(s for s in plan.setups if s.sighting is Sighting.PIXELS)
    landmarks = plan.landmarks
    with _server(plan, setup) as address:
        frames = labelled_frames(
            address,
            landmarks=landmarks,
            count=plan.training_frames,
            seed=plan.seed + 1,
            on_frame=lambda: advance("train"),
        )
        classifier = train(frames)
        save_classifier(classifier, plan.output / "classifier.npz")
        _draw_view(plan, address, classifier)
    return classifier


def run_setup(
    plan: Plan, setup: Setup, classifier: ColourClassifier | None, advance: Advance
) -> SetupResult:
    """Drive every seed on one server and replay every filter."""
    landmarks = plan.landmarks
    with _server(plan, setup) as address:
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


def _server(plan: Plan, setup: Setup) -> Any:
    return running_server(
        plan.robot(setup),
        plan.world,
        seed=plan.seed,
        log=plan.output / f"server_{setup.name}.log",
        extra=plan.server_arguments,
    )


# ---- results
# ----------------------------------------------------------------------------------------


def summarise(plan: Plan, results: Sequence[SetupResult]) -> dict[str, Any]:
    """Return everything that summary.json holds of the drives."""
    setups = {
        result.setup.name: {
            "title": result.setup.title,
            "landmarks": result.setup.sighting.value,
            "measurements": measurement_figures(result.recordings, plan.landmarks),
            "filters": {
                f.name: {"title": f.title, **summary(result.traces[f.name])} for f in FILTERS
            },
        }
        for result in results
    }
    claims = [asdict(claim) for claim in paper_claims(setups)]
    return {"seed": plan.seed, "runs": plan.runs, "setups": setups, "claims": claims}


def draw_drives(plan: Plan, results: Sequence[SetupResult]) -> list[Picture]:
    """Draw trajectories and errors of the typical run of each set-up, and the ensembles."""
    chosen = []
    for result in results:
        traces = result.traces[PAPER_FILTER.name]
        index = typical(traces)
        chosen.append((result, result.recordings[index], traces[index]))
    maps = [(f"{r.setup.name}, run {t.seed}", recording, t) for r, recording, t in chosen]
    draw_trajectories(plan.output / "trajectories.png", maps, plan.landmarks)
    draw_errors(
        plan.output / "errors.png", [(f"{r.setup.name}, run {t.seed}", t) for r, _, t in chosen]
    )
    draw_ensemble(
        plan.output / "ensemble.png",
        [(f"{r.setup.name}, {plan.runs} runs", r.traces[PAPER_FILTER.name]) for r in results],
    )
    return [
        Picture(
            "trajectories.png",
            "Self-localisation on the field (the paper's Figure 12)",
            "The run whose largest error is the median one. The open circle is the start.",
            "Maps of the true path, the path by odometry alone and the filter's estimate",
        ),
        Picture(
            "errors.png",
            "Distance between true and estimated place (the paper's Figure 13)",
            "The bars count, step by step, the landmarks that the validation gate accepted (up) and "
            "rejected (down). In the real set-up the filter starts too certain: it trusts its "
            "odometry and rejects, until the turn at the first corner (step 24) widens its belief.",
            "Position error over the steps for odometry and filter",
        ),
        Picture(
            "ensemble.png",
            "The same over all seeds",
            "Median and the band from 5 % to 95 % of the runs, the paper's filter.",
            "Bands of position error over the steps for all runs",
        ),
    ]


def _draw_view(plan: Plan, address: ServerAddress, classifier: ColourClassifier) -> None:
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
        view = look(detector, frame)
        draw_classifier_view(plan.output / "classifier.png", frame, detector, view)


CLASSIFIER_PICTURE = Picture(
    "classifier.png",
    "What the classifier sees",
    "A frame as it came over TCP, its cylinder, and the pixels whose likelihood ratio passes the "
    "threshold of Eq. 3. Two stacked colours make a beacon; its place in the cylinder gives "
    "bearing and range.",
    "Omnidirectional frame, unwarped cylinder and colour labels with detected landmarks",
)


def write_results(
    plan: Plan,
    results: Sequence[SetupResult],
    camera_pictures: Sequence[Picture],
    *,
    camera_numbers: dict[str, Any],
    timing_s: dict[str, float],
    subtitle: str,
) -> Path:
    """Write summary.json and report.html; return the report's path."""
    numbers = summarise(plan, results)
    drives = draw_drives(plan, results)
    document = {**numbers, "camera": camera_numbers, "timing_s": timing_s}
    text = json.dumps(document, indent=2, allow_nan=False)
    (plan.output / "summary.json").write_text(text + "\n", encoding="utf-8")
    return write_report(
        plan.output,
        subtitle=subtitle,
        runs=plan.runs,
        claims=paper_claims(numbers["setups"]),
        camera=camera_pictures,
        landmarks=[CLASSIFIER_PICTURE],
        drive=drives,
        summary=numbers,
        timing="Time used: " + ", ".join(f"{k} {v:.0f} s" for k, v in timing_s.items()) + ".",
    )
