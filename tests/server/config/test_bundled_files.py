"""Configurations by name: every bundled file is found, and a wrong name lists them all."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.known_names import FileKind, bundled_files, find_configuration
from helpers.configs import FIELD, OMNI_ROBOT, ROBOTS, WORLDS


@pytest.mark.parametrize(("kind", "folder"), [("robots", ROBOTS), ("worlds", WORLDS)])
def test_bundled_files_when_listed_are_those_of_the_repository(
    kind: FileKind, folder: Path
) -> None:
    names = [path.name for path in bundled_files(kind)]
    assert names == sorted(path.name for path in folder.glob("*.ini"))
    assert len(names) > 2


@pytest.mark.parametrize(
    ("kind", "name", "file"), [("robots", "p2at_omni", OMNI_ROBOT), ("worlds", FIELD.stem, FIELD)]
)
def test_name_when_bundled_is_the_file(kind: FileKind, name: str, file: Path) -> None:
    assert find_configuration(kind, name).resolve() == file


@pytest.mark.parametrize("text", ["mine.ini", "folder/mine", "folder/mine.ini"])
def test_path_when_given_is_returned_unchanged(text: str) -> None:
    assert find_configuration("robots", text) == Path(text)


def test_name_when_a_file_of_that_name_is_here_is_that_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("p2at_omni").touch()
    assert find_configuration("robots", "p2at_omni") == Path("p2at_omni")


def test_name_when_unknown_lists_the_bundled_ones() -> None:
    with pytest.raises(ConfigError, match=r"bundled robots: .*p2at_omni,"):
        find_configuration("robots", "p2atomni")
