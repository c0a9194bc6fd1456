"""Landmark files by name: the bundled file is found, an unknown name lists the known ones."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_client.bundled_landmarks import find_landmark_file
from catoptra_protocol.errors import ConfigError
from helpers.configs import REPOSITORY


def test_name_when_bundled_is_the_file() -> None:
    file = REPOSITORY / "configs/landmarks/four_legged_2006.csv"
    assert find_landmark_file("four_legged_2006").resolve() == file


@pytest.mark.parametrize("text", ["mine.csv", "folder/mine", "folder/mine.csv"])
def test_path_is_returned_unchanged(text: str) -> None:
    assert find_landmark_file(text) == Path(text)


def test_name_when_unknown_is_answered_with_those_that_are_there() -> None:
    with pytest.raises(ConfigError, match="comes with the client: arena, four_legged_2006"):
        find_landmark_file("four_legged")
