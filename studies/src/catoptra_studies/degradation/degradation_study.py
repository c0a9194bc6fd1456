"""The study of degraded images: a server for each level, recorded drives, two classifiers.

One classifier has been trained on clean images, like the paper's, the other on images of the level
at hand. Where the first fails and the second does not, images are only different; where both fail,
information is lost.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from catoptra_client.landmarks import ColourClassifier
from catoptra_studies.degradation.degradation_metrics import (
    DegradationMetrics,
    ExampleFrame,
    compute_degradation_metrics,
    select_example,
)
from catoptra_studies.degradation.degradation_sweeps import (
    DegradationSweep,
    clean_robot_ini,
    degraded_robot_ini,
)
from catoptra_studies.degradation.recorded_drive import RecordedDrive, detect_beacons, record_drive
from catoptra_studies.experiment.experiment_runner import (
    ExperimentConfig,
    open_server,
    train_on_server,
)

TRAINED_ON_CLEAN = "clean"
TRAINED_ON_DEGRADED = "degraded"
# One server renders while a frame of the other is classified: two levels keep two cores busy.
_NUM_WORKERS = 2

DriveCallback = Callable[[], None]


@dataclass(frozen=True, slots=True, eq=False)
class LevelResult:
    """Results of one level."""

    label: str

    metrics: Mapping[str, DegradationMetrics]
    """Metrics by the images that the classifier was trained on."""

    example: ExampleFrame
    """A frame with the detections of the classifier trained on clean images."""


@dataclass(frozen=True, slots=True, eq=False)
class SweepResult:
    """Results of one sweep."""

    sweep: DegradationSweep
    clean: LevelResult

    levels: tuple[LevelResult, ...]
    """Results from slight to hopeless, in the order of the sweep's levels."""


def num_drives(config: ExperimentConfig, sweeps: Sequence[DegradationSweep]) -> int:
    """Number of drives of a study."""
    return config.num_runs * (1 + sum(len(sweep.levels) for sweep in sweeps))


def run_degradation_study(
    config: ExperimentConfig,
    sweeps: Sequence[DegradationSweep],
    *,
    robot_folder: Path,
    on_drive: DriveCallback,
) -> tuple[SweepResult, ...]:
    """Run all sweeps.

    Args:
        config: Number of drives, seed and output folder; the first set-up has the route.
        sweeps: Sweeps to run.
        robot_folder: Folder of the robot files on which the levels are based.
        on_drive: Called after each drive, from any thread.
    """
    clean_ini = clean_robot_ini(robot_folder)
    clean_classifier, drives = _record_drives(config, clean_ini, "clean", on_drive)
    clean = _evaluate_level(config, drives, "clean", {TRAINED_ON_CLEAN: clean_classifier})
    with ThreadPoolExecutor(_NUM_WORKERS) as pool:
        # All levels of all sweeps at once, so that no worker idles at the end of a sweep.
        futures = [
            [
                pool.submit(
                    _run_level,
                    config,
                    degraded_robot_ini(sweep, keys, robot_folder),
                    # By number: labels such as cos^4 are no file names.
                    name=f"{sweep.slug}_{number}",
                    label=label,
                    clean_classifier=clean_classifier,
                    on_drive=on_drive,
                )
                for number, (label, keys) in enumerate(sweep.levels.items(), 1)
            ]
            for sweep in sweeps
        ]
        try:
            return tuple(
                SweepResult(sweep, clean, tuple(future.result() for future in row))
                for sweep, row in zip(sweeps, futures, strict=True)
            )
        except BaseException:
            # Else leaving the block would first measure all levels that still wait.
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _run_level(
    config: ExperimentConfig,
    robot_ini: str,
    *,
    name: str,
    label: str,
    clean_classifier: ColourClassifier,
    on_drive: DriveCallback,
) -> LevelResult:
    """Record drives at one level and evaluate both classifiers on the same frames."""
    degraded_classifier, drives = _record_drives(config, robot_ini, name, on_drive)
    classifiers = {TRAINED_ON_CLEAN: clean_classifier, TRAINED_ON_DEGRADED: degraded_classifier}
    return _evaluate_level(config, drives, label, classifiers)


def _record_drives(
    config: ExperimentConfig, robot_ini: str, name: str, on_drive: DriveCallback
) -> tuple[ColourClassifier, tuple[RecordedDrive, ...]]:
    """Train a classifier from a server's frames, then record a drive for each seed."""
    robot_file = config.output_folder.resolve() / f"{name}.ini"
    robot_file.write_text(robot_ini, encoding="utf-8")
    # The name makes the server's log file, so levels that run together need different ones.
    setup = replace(config.setups[0], name=name, robot_file=str(robot_file))
    with open_server(config, setup) as address:
        # On the same server, hence on images degraded like the drives' own.
        classifier = train_on_server(config, address)
        drives = []
        for run in range(config.num_runs):
            drives.append(record_drive(setup, run, address))
            on_drive()
    return classifier, tuple(drives)


def _evaluate_level(
    config: ExperimentConfig,
    drives: Sequence[RecordedDrive],
    label: str,
    classifiers: Mapping[str, ColourClassifier],
) -> LevelResult:
    landmarks = config.landmarks
    detections = {
        training: [detect_beacons(drive, classifier, landmarks) for drive in drives]
        for training, classifier in classifiers.items()
    }
    metrics = {
        training: compute_degradation_metrics(
            drives, found, setup=config.setups[0], landmarks=landmarks
        )
        for training, found in detections.items()
    }
    example = select_example(drives[0], detections[TRAINED_ON_CLEAN][0])
    return LevelResult(label, metrics, example)
