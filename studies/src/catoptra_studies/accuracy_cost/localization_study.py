"""Localization by frames of the key levels: the paper's simulated drive through server processes.

Each level has a server of its own that renders at the level. The same seeds drive round the
field, a detector finds landmarks in the frames received over TCP, and filters localize by them.
Rates and errors of the drives are a row of the results.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from catoptra_protocol.landmarks import Landmark
from catoptra_server.config.known_names import find_configuration
from catoptra_studies.accuracy_cost.cost_results import (
    LevelCost,
    LocalizationAccuracy,
    LocalizationRow,
)
from catoptra_studies.accuracy_cost.cost_study import CostStudyConfig
from catoptra_studies.commands import ProgressDisplay
from catoptra_studies.experiment.experiment_runner import (
    ExperimentConfig,
    SetupResult,
    run_setup,
    train_classifier,
)
from catoptra_studies.experiment.experiment_setups import (
    CONSISTENT_FILTER,
    MAX_RANGE_M,
    PAPER_FILTER,
    SIM,
)
from catoptra_studies.experiment.localization_filter import FilterRun
from catoptra_studies.experiment.metrics import detection_rate, rms_errors

# A nearer beacon is at least 5 px wide in an image of 360 px: a miss has another cause than size.
_NEAR_RANGE_M = 1.5


def _localization_row(
    level: str, result: SetupResult, landmarks: Sequence[Landmark]
) -> LocalizationRow:
    """Rates and errors over all drives with frames of a level."""
    drive_logs = result.drive_logs
    range_rms_m, bearing_rms_deg = rms_errors(drive_logs, landmarks)
    paper, consistent = (
        _position_errors(result.filter_runs[settings.name])
        for settings in (PAPER_FILTER, CONSISTENT_FILTER)
    )
    return LocalizationRow(
        level=level,
        num_frames=sum(len(drive_log.steps) - 1 for drive_log in drive_logs),
        detection_rate=detection_rate(drive_logs, landmarks, max_distance_m=MAX_RANGE_M),
        near_detection_rate=detection_rate(drive_logs, landmarks, max_distance_m=_NEAR_RANGE_M),
        bearing_rms_deg=bearing_rms_deg,
        range_rms_m=range_rms_m,
        ekf_mean_m=paper[0],
        ekf_max_m=paper[1],
        consistent_ekf_mean_m=consistent[0],
        consistent_ekf_max_m=consistent[1],
    )


def _position_errors(filter_runs: Sequence[FilterRun]) -> tuple[float, float]:
    """Medians over the drives of a drive's mean and largest position error, in metres."""
    # The start is left out of the mean: that position is given.
    means_m = [run.estimate_error_m[1:].mean() for run in filter_runs]
    # Medians below, since one locked-out drive would decide a mean of ten.
    maxima_m = [run.estimate_error_m.max() for run in filter_runs]
    return float(np.median(means_m)), float(np.median(maxima_m))


def summarize_localization(
    results: Mapping[str, SetupResult], landmarks: Sequence[Landmark]
) -> LocalizationAccuracy:
    """Rates and errors of the drives with frames of each level, by the level's name."""
    # Of any level: odometry is the same in all, since the seeds are.
    filter_runs = next(iter(results.values())).filter_runs[PAPER_FILTER.name]
    return LocalizationAccuracy(
        num_runs=len(filter_runs),
        steps_per_run=len(filter_runs[0].odometry_error_m) - 1,
        odometry_max_m=float(np.median([run.odometry_error_m.max() for run in filter_runs])),
        rows=tuple(_localization_row(*pair, landmarks) for pair in results.items()),
    )


_NUM_TRAINING_FRAMES = 30


def select_key_levels(levels: Sequence[LevelCost]) -> list[LevelCost]:
    """Key levels from coarse to exact."""
    return sorted((level for level in levels if level.is_key), key=lambda level: -level.rmse)


def measure_localization(
    config: CostStudyConfig, levels: Sequence[LevelCost], progress: ProgressDisplay
) -> LocalizationAccuracy:
    """Drive robots with frames of each level.

    Args:
        config: Extent of the study; the output folder receives robot files and servers' logs.
        levels: Levels from coarse to exact, at least one.
        progress: Display of the drives.
    """
    on_frame = progress.add_task("train: labelled frames", _NUM_TRAINING_FRAMES)
    # One classifier, from the best frames: else the training would differ between levels as well.
    training_config = _level_config(config, levels[-1])
    classifier, _ = train_classifier(training_config, on_frame=on_frame)
    results = {}
    for level in levels:
        level_config = _level_config(config, level)
        (setup,) = level_config.setups
        on_step = progress.add_task(level.name, level_config.num_runs * (len(SIM.route) - 1))
        results[level.name] = run_setup(level_config, setup, classifier, on_step=on_step)
    return summarize_localization(results, training_config.landmarks)


def _level_config(config: CostStudyConfig, level: LevelCost) -> ExperimentConfig:
    """The paper's simulated drive, with frames of one level."""
    base_robot = find_configuration("robots", Path(SIM.robot_file).stem)
    robot_file = config.output_folder.resolve() / "robot.ini"
    # Only the camera's sections differ: the simulated robot's drive, sensors and noise stay.
    based_on = f"[Configuration]\nBasedOn={base_robot.resolve()}\n"
    robot_file.write_text(based_on + level.robot_ini, encoding="utf-8")
    return ExperimentConfig(
        config_folder=None,
        output_folder=config.output_folder,
        setups=(replace(SIM, robot_file=str(robot_file)),),
        num_runs=1 if config.is_quick else config.num_runs,
        seed=config.seed,
        num_training_frames=_NUM_TRAINING_FRAMES,
        server_arguments=("--renderer", level.renderer),
    )
