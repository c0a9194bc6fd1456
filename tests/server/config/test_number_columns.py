"""Columns of numbers in files beside a robot's: separators, titles, and faults at their lines."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import Columns, read_columns

PROFILE = """# millimetres, of a measuring machine
radius, height
0, 5.0
10, 5.8

20, 8.2
30; 12.2
40\t17.8
"""


def read(folder: Path, content: str) -> Columns:
    """Columns of a file that a section names."""
    (folder / "ball.csv").write_text(content)
    path = folder / "mirror.ini"
    path.write_text("[M]\nProfile=ball.csv\n")
    return read_columns(IniFile(path).get_section("M"), "Profile", ("Radii", "Sags"))


def test_rows_have_any_separator_and_one_line_of_titles(tmp_path: Path) -> None:
    assert read(tmp_path, PROFILE) == (
        (0.0, 10.0, 20.0, 30.0, 40.0),
        (5.0, 5.8, 8.2, 12.2, 17.8),
    )


def test_file_without_rows_has_empty_columns(tmp_path: Path) -> None:
    assert read(tmp_path, "# nothing\n") == ((), ())


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (PROFILE.replace("20, 8.2", "20"), r"ball\.csv:6: Profile='20': expected 2 numbers, Radii"),
        (PROFILE.replace("20, 8.2", "20, 8.2, 9"), r"ball\.csv:6: .*Radii and Sags"),
        (PROFILE.replace("20, 8.2", "20, x"), r"ball\.csv:6: .*Radii and Sags"),
        (PROFILE.replace("20, 8.2", "20, nan"), r"ball\.csv:6: .*Radii and Sags"),
        (PROFILE.replace("20, 8.2", "x, y"), r"ball\.csv:6: .*Radii and Sags"),
        (PROFILE.replace("20, 8.2", "10, 8.2"), r"ball\.csv:6: .*Radii above 10\.0"),
        (PROFILE.replace("0, 5.0\n", "title\n", 1), r"ball\.csv:3: .*Radii and Sags"),
        ("x" * 2**21, r"ball\.csv: .*a smaller table of numbers"),
    ],
)
def test_fault_is_named_with_file_and_line(tmp_path: Path, content: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        read(tmp_path, content)


def test_missing_file_is_named_with_its_key(tmp_path: Path) -> None:
    path = tmp_path / "mirror.ini"
    path.write_text("[M]\nProfile=none.csv\n")
    with pytest.raises(ConfigError, match=r"mirror\.ini:2: M\.Profile='none\.csv'"):
        read_columns(IniFile(path).get_section("M"), "Profile", ("Radii", "Sags"))
