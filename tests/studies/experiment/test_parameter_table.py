"""The table has the numbers that robot files and filters have."""

from __future__ import annotations

from configparser import ConfigParser

import pytest

from catoptra_studies.experiment.experiment_report import ODOMETRY_ERRORS, parameter_table
from catoptra_studies.experiment.experiment_setups import SETUPS
from helpers.configs import REPOSITORY


@pytest.mark.parametrize("setup", SETUPS, ids=lambda setup: setup.name)
def test_odometry_errors_are_those_of_the_robot_file(setup):
    file = ConfigParser(inline_comment_prefixes=";")
    file.optionxform = str  # type: ignore[assignment,method-assign]
    assert file.read(REPOSITORY / "configs" / "robots" / setup.robot_file)
    errors = {key: float(text) for key, text in file["USARBot.OdometrySensor"].items()}
    assert errors == ODOMETRY_ERRORS[setup.name]


@pytest.mark.parametrize(
    "text",
    ["sim 1.0°, real −5.2°", "0.40 m of the range, 2.5°", "10% of the distance, 1.32° a metre"],
)
def test_table_has_the_numbers_of_setups_and_filters(text):
    assert text in parameter_table()
