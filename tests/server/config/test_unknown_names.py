"""Unknown names: errors in our sections, warnings in others, each with what was probably meant."""

from __future__ import annotations

import logging
from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.known_names import UnknownName, report_unknown_names, suggest_name

WHERE = SourceLocation("robot.ini", 7)


@pytest.mark.parametrize(
    ("name", "suggestion"),
    [
        ("Polygon", "Polygons"),
        ("polygons ", "Polygons"),
        ("MetresPerUnits", "MetresPerUnit"),
        ("MetersPerUnit", "MetresPerUnit"),
        ("Rim", ""),
        ("bDebug", ""),
    ],
)
def test_suggestion_is_the_most_similar_known_name(name: str, suggestion: str) -> None:
    assert suggest_name(name, ["K", "C", "Polygons", "MetresPerUnit", "RimAngle"]) == suggestion


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
