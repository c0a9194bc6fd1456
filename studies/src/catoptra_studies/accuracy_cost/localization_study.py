"""Localization by frames of the key levels: the paper's simulated drive through server processes.

Each level has a server of its own that renders at the level. The same seeds drive round the
field, a detector finds landmarks in the frames received over TCP, and filters localize by them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from catoptra_server.config.bundled_files import find_configuration
from catoptra_studies.accuracy_cost.cost_results import LevelCost, LocalizationAccuracy
from catoptra_studies.accuracy_cost.cost_study import CostStudyConfig
from catoptra_studies.accuracy_cost.localization_accuracy import (
    localization_row,
    summarize_localization,
)
from catoptra_studies.experiment.experiment_runner import (
    ExperimentConfig,
    run_setup,
    train_classifier,
)
from catoptra_studies.experiment.experiment_setups import SIM
from catoptra_studies.progress_display import ProgressDisplay

_NUM_TRAINING_FRAMES = 30


def select_key_levels(levels: Sequence[LevelCost]) -> list[LevelCost]:
    """Key levels from coarse to exact."""
    return sorted((level for level in levels if level.is_key), key=lambda level: -level.rmse)


def measure_localization(
    config: CostStudyConfig, levels: Sequence[LevelCost], progress: ProgressDisplay
) -> LocalizationAccuracy:
    """Drive robots with frames of each level.

    Args:
        config: Extent of the study; its output folder receives robot files and servers' logs.
        levels: Levels from coarse to exact, at least one.
        progress: Display of the drives.
    """
    advance = progress.add_task("train: labelled frames", _NUM_TRAINING_FRAMES)
    # One classifier, from the best frames: else a level would be evaluated by its training as well.
    classifier, _ = train_classifier(_level_config(config, levels[-1]), lambda _: advance())
    rows, results = [], []
    for level in levels:
        level_config = _level_config(config, level)
        advance = progress.add_task(level.name, level_config.num_runs * (len(SIM.route) - 1))
        result = run_setup(
            level_config,
            level_config.setups[0],
            classifier,
            lambda _, advance=advance: advance(),  # type: ignore[misc] # bound now, not later
        )
        rows.append(localization_row(level.name, result, level_config.landmarks))
        results.append(result)
    # Any result would do: odometry does not depend on frames.
    return summarize_localization(rows, results[-1])


def _level_config(config: CostStudyConfig, level: LevelCost) -> ExperimentConfig:
    """The paper's simulated drive, with frames of one level."""
    robot_file = config.output_folder.resolve() / "robot.ini"
    write_robot_file(level, find_configuration("robots", Path(SIM.robot_file).stem), robot_file)
    return ExperimentConfig(
        config_folder=None,
        output_folder=config.output_folder,
        setups=(replace(SIM, robot_file=str(robot_file)),),
        num_runs=1 if config.is_quick else config.num_runs,
        seed=config.seed,
        num_training_frames=_NUM_TRAINING_FRAMES,
        server_arguments=("--renderer", level.renderer),
    )


def write_robot_file(level: LevelCost, base_robot: Path, path: Path) -> None:
    """Write a robot file that is another one, rendered at a level."""
    # Only the camera's sections differ: drive, sensors and noise stay those of the simulated robot.
    based_on = f"[Configuration]\nBasedOn={base_robot.resolve()}\n"
    path.write_text(based_on + level.robot_ini, encoding="utf-8")
