"""Unknown names with what was probably meant; bundled files by name, and lists of them."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.known_names import (
    FileKind,
    UnknownName,
    bundled_files,
    find_configuration,
    report_unknown_names,
)
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


@pytest.mark.parametrize("name", ["p2atomni", "x" * 300, "a\0b"])
def test_name_when_unknown_lists_the_bundled_ones(name: str) -> None:
    with pytest.raises(ConfigError, match=r"bundled robots: .*p2at_omni,"):
        find_configuration("robots", name)


WHERE = SourceLocation("robot.ini", 7)


def test_unknown_key_of_our_section_is_an_error() -> None:
    unknown = UnknownName("Polygon", "16", WHERE, "Catoptra.HyperbolicMirror", "Polygons")
    with pytest.raises(ConfigError, match=r"robot.ini:7: Catoptra.HyperbolicMirror.Polygon='16': ex"
                       r"pected a known key; did you mean Polygons\?"):  # fmt: skip
        report_unknown_names([unknown])


def test_unknown_key_of_another_section_is_a_warning_unless_strict(
    caplog: pytest.LogCaptureFixture,
) -> None:
    unknown = UnknownName("bDebug", "1", WHERE, "USARBot.P2AT")
    with caplog.at_level(logging.WARNING):
        report_unknown_names([unknown])
    assert caplog.messages == ["robot.ini:7: key bDebug is unknown and has no effect"]
    with pytest.raises(ConfigError, match="bDebug"):
        report_unknown_names([unknown], is_strict=True)


def test_section_of_ours_that_nothing_uses_is_an_error_if_misspelt_and_else_a_warning(
    caplog: pytest.LogCaptureFixture,
) -> None:
    spare = UnknownName("", "", WHERE, "Catoptra.ParabolicMirror")
    with caplog.at_level(logging.WARNING):
        report_unknown_names([spare])
    assert caplog.messages == ["robot.ini:7: nothing uses [Catoptra.ParabolicMirror]"]
    misspelt = UnknownName("", "", WHERE, "Catoptra.OmniCaptureCamra", "Catoptra.OmniCaptureCamera")
    with pytest.raises(ConfigError, match=r"expected a section in use: Catoptra.OmniCaptureCamera"):
        report_unknown_names([misspelt])


def test_names_of_a_file_are_those_that_no_reader_has_read(tmp_path: Path) -> None:
    path = tmp_path / "a.ini"
    path.write_text(
        "[Catoptra.One]\nKnown=1\nKnwon=2\n[Catoptra.Twoo]\nA=1\n[USARBot.Three]\nA=1\n"
    )
    file = IniFile(path)
    file.get_section("Catoptra.One").get_int("Known")
    file.get_section("Catoptra.Two").get_int("A", 0)
    found = [(name.section, name.key, name.suggestion) for name in file.unknown_names()]
    assert found == [("Catoptra.One", "Knwon", "Known"), ("Catoptra.Twoo", "", "Catoptra.Two")]
