"""The work of the study, nothing printed: a server a rung, films, two classifiers, figures.

One classifier has learnt from clean pictures, as the paper's; the other anew from pictures like
those that it is shown. Where the first fails and the second does not, pictures are different;
where both do, they are worse.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from catoptra_client.landmarks import ColourClassifier, train
from catoptra_client.training_frames import capture_training_frames
from catoptra_studies.degradation.degradation_metrics import (
    DegradationMetrics,
    compute_degradation_metrics,
)
from catoptra_studies.degradation.degradation_sweeps import (
    DegradationSweep,
    clean_robot_ini,
    degraded_robot_ini,
)
from catoptra_studies.degradation.example_frame import ExampleFrame, select_example
from catoptra_studies.degradation.recorded_drive import (
    RecordedDrive,
    detect_beacons,
    make_drive_detector,
    record_drive,
)
from catoptra_studies.experiment.experiment_runner import ExperimentConfig, open_server

# What a classifier has learnt from.
TRAINED_ON_CLEAN = "clean"
TRAINED_ON_DEGRADED = "same"
# A server draws while another's frame is looked at: two fill two cores.
_NUM_WORKERS = 2

DriveCallback = Callable[[], None]


@dataclass(frozen=True, slots=True, eq=False)
class LevelResult:
    """What came of a rung, by what the classifier had learnt from; the sample is TRAINED_ON_CLEAN's."""

    label: str
    metrics: Mapping[str, DegradationMetrics]
    example: ExampleFrame


@dataclass(frozen=True, slots=True, eq=False)
class SweepResult:
    """What came of a ladder."""

    sweep: DegradationSweep
    clean: LevelResult
    levels: tuple[LevelResult, ...]


def num_drives(config: ExperimentConfig, sweeps: Sequence[DegradationSweep]) -> int:
    """Return how many drives a study takes."""
    return config.num_runs * (1 + sum(len(ladder.levels) for ladder in sweeps))


def run_degradation_study(
    config: ExperimentConfig,
    sweeps: Sequence[DegradationSweep],
    *,
    robot_folder: Path,
    on_drive: DriveCallback,
) -> tuple[SweepResult, ...]:
    """Return the ladders' results; the plan's first set-up says which way to drive."""
    learnt, clean = _run_clean(config, clean_robot_ini(robot_folder), on_drive)
    with ThreadPoolExecutor(_NUM_WORKERS) as pool:

        def begun(ladder: DegradationSweep, number: int) -> Future[LevelResult]:
            rung = ladder.levels[number]
            return pool.submit(
                _run_level,
                config,
                degraded_robot_ini(ladder, rung, robot_folder),
                name=f"{ladder.slug}_{number + 1}",
                label=rung.label,
                clean_classifier=learnt,
                on_drive=on_drive,
            )

        begun_all = [[begun(one, n) for n in range(len(one.levels))] for one in sweeps]
        try:
            return tuple(
                SweepResult(ladder, clean, tuple(rung.result() for rung in rungs))
                for ladder, rungs in zip(sweeps, begun_all, strict=True)
            )
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)  # else all others are measured first
            raise


def _run_clean(
    config: ExperimentConfig, robot_ini: str, on_drive: DriveCallback
) -> tuple[ColourClassifier, LevelResult]:
    """Return the classifier that learns from clean pictures, and how it does in them."""
    classifier, films = _record_drives(config, robot_ini, "clean", on_drive)
    return classifier, _evaluate_level(config, films, "clean", {TRAINED_ON_CLEAN: classifier})


def _run_level(
    config: ExperimentConfig,
    robot_ini: str,
    *,
    name: str,
    label: str,
    clean_classifier: ColourClassifier,
    on_drive: DriveCallback,
) -> LevelResult:
    anew, films = _record_drives(config, robot_ini, name, on_drive)
    return _evaluate_level(
        config, films, label, {TRAINED_ON_CLEAN: clean_classifier, TRAINED_ON_DEGRADED: anew}
    )


def _record_drives(
    config: ExperimentConfig, robot_ini: str, name: str, on_drive: DriveCallback
) -> tuple[ColourClassifier, tuple[RecordedDrive, ...]]:
    """Return a classifier trained from a server's pictures, and a film of each seed on it."""
    file = config.output_folder.resolve() / f"{name}.ini"
    file.write_text(robot_ini, encoding="utf-8")
    setup = replace(config.setups[0], name=name, robot_file=str(file))
    with open_server(config, setup) as address:
        frames = capture_training_frames(
            address,
            landmarks=config.landmarks,
            num_frames=config.num_training_frames,
            seed=config.seed + 1,
            on_frame=lambda: None,
        )
        classifier = train(frames)
        films = []
        for run in range(config.num_runs):
            films.append(record_drive(setup, run, address, on_step=lambda: None))
            on_drive()
    return classifier, tuple(films)


def _evaluate_level(
    config: ExperimentConfig,
    drives: Sequence[RecordedDrive],
    label: str,
    classifiers: Mapping[str, ColourClassifier],
) -> LevelResult:
    landmarks = config.landmarks
    found = {
        learnt: [detect_beacons(f, make_drive_detector(f, classifier, landmarks)) for f in drives]
        for learnt, classifier in classifiers.items()
    }
    numbers = {
        learnt: compute_degradation_metrics(
            drives, seen, setup=config.setups[0], landmarks=landmarks
        )
        for learnt, seen in found.items()
    }
    return LevelResult(label, numbers, select_example(drives[0], found[TRAINED_ON_CLEAN][0]))
