"""Whole files: sections of one name together, and files based on others."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.ini_file import IniFile

MAX_BASE_FILES = 16


def write_file(folder: Path, name: str, *lines: str) -> Path:
    path = folder / name
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_section_when_repeated_is_one_with_all_lines(tmp_path: Path) -> None:
    file = IniFile(write_file(tmp_path, "x.ini", "[A]", "K=1", "L=(N=1)", "[a]", "K=2", "L=(N=2)"))
    assert file.section_names() == ["A"]
    assert file.get_section("A").get_float("K") == 2.0
    assert [struct.get_int("N") for struct in file.get_section("A").get_structs("L")] == [1, 2]


def test_section_when_absent_is_empty_and_its_errors_name_the_file(tmp_path: Path) -> None:
    path = write_file(tmp_path, "x.ini", "[A]")
    file = IniFile(path)
    assert not file.has_section("B")
    with pytest.raises(ConfigError, match=r"x\.ini: B\.K=''.*there is no section"):
        file.get_section("B").get_float("K")


def test_file_when_based_on_another_overrides_it(tmp_path: Path) -> None:
    write_file(tmp_path, "base.ini", "[A]", "K=1", "M=5", "[B]", "K=7")
    path = write_file(tmp_path, "x.ini", "[Configuration]", "BasedOn=base.ini", "[A]", "K=2")
    file = IniFile(path)
    assert [file.get_section("A").get_float(key) for key in "KM"] == [2.0, 5.0]
    assert file.get_section("B").get_float("K") == 7.0


def test_robot_file_is_based_on_a_bundled_camera_by_its_name(tmp_path: Path) -> None:
    path = write_file(tmp_path, "x.ini", "[Configuration]", "BasedOn=kaidan_360")
    assert IniFile(path).get_section("Catoptra.Kaidan360").get_str("Lens") == "unified"


def test_file_when_an_inherited_value_is_wrong_names_the_base(tmp_path: Path) -> None:
    write_file(tmp_path, "base.ini", "[A]", "K=x")
    path = write_file(tmp_path, "x.ini", "[Configuration]", "BasedOn=base.ini")
    with pytest.raises(ConfigError, match=r"base\.ini:2"):
        IniFile(path).get_section("A").get_float("K")


@pytest.mark.parametrize("second", ["x.ini", "y.ini"])
def test_file_when_based_on_itself_in_a_loop_is_rejected(tmp_path: Path, second: str) -> None:
    write_file(tmp_path, "y.ini", "[Configuration]", "BasedOn=x.ini")
    path = write_file(tmp_path, "x.ini", "[Configuration]", f"BasedOn={second}")
    with pytest.raises(ConfigError, match=r":2: Configuration\.BasedOn=.*not based on this"):
        IniFile(path)


def write_chain(folder: Path, num_bases: int) -> Path:
    """File 0, based on file 1 and so on; each has the key K of its number."""
    for n in range(num_bases + 1):
        based_on = (f"BasedOn={n + 1}.ini",) if n < num_bases else ()
        write_file(folder, f"{n}.ini", "[Configuration]", *based_on, "[A]", f"K{n}={n}", f"K={n}")
    return folder / "0.ini"


def test_file_based_on_as_many_files_as_allowed_has_the_keys_of_all(tmp_path: Path) -> None:
    section = IniFile(write_chain(tmp_path, MAX_BASE_FILES)).get_section("A")
    assert [section.get_int(f"K{n}") for n in range(17)] == list(range(17))
    assert section.get_int("K") == 0


@pytest.mark.parametrize("num_bases", [MAX_BASE_FILES + 1, 1000])
def test_file_based_on_more_files_is_rejected_at_the_last_allowed(
    tmp_path: Path, num_bases: int
) -> None:
    path = write_chain(tmp_path, num_bases)
    with pytest.raises(ConfigError, match=r"16\.ini:2: .*BasedOn.*at most 16 files"):
        IniFile(path)


def test_file_when_its_base_is_missing_names_the_line(tmp_path: Path) -> None:
    path = write_file(tmp_path, "x.ini", "[Configuration]", "BasedOn=gone.ini")
    with pytest.raises(ConfigError, match=r"x\.ini:2: .*a file that exists"):
        IniFile(path)


def test_unknown_keys_of_a_section_never_used_are_not_reported(tmp_path: Path) -> None:
    file = IniFile(write_file(tmp_path, "x.ini", "[A]", "K=1", "Typo=2", "[Other]", "K=1"))
    file.get_section("A").get_float("K")
    assert [entry.key for entry in file.unknown_names()] == ["Typo"]


def test_file_based_on_two_files_has_the_keys_of_both_the_second_first(tmp_path: Path) -> None:
    write_file(tmp_path, "robot.ini", "[A]", "K=1", "L=1", "M=1")
    write_file(tmp_path, "camera.ini", "[A]", "L=2", "M=2")
    path = write_file(
        tmp_path,
        "x.ini",
        "[Configuration]",
        "BasedOn=robot.ini",
        "BasedOn=camera.ini",
        "[A]",
        "M=3",
    )
    section = IniFile(path).get_section("A")
    assert [section.get_int(key) for key in "KLM"] == [1, 2, 3]


def test_base_of_two_bases_is_read_once_before_both(tmp_path: Path) -> None:
    write_file(tmp_path, "base.ini", "[A]", "K=1")
    write_file(tmp_path, "one.ini", "[Configuration]", "BasedOn=base.ini", "[A]", "K=2")
    write_file(tmp_path, "two.ini", "[Configuration]", "BasedOn=base.ini", "[A]", "L=3")
    path = write_file(
        tmp_path, "x.ini", "[Configuration]", "BasedOn=one.ini", "BasedOn=two.ini", "[B]", "M=4"
    )
    assert IniFile(path).get_section("A").get_int("K") == 2


def test_second_base_that_is_missing_is_named(tmp_path: Path) -> None:
    write_file(tmp_path, "one.ini", "[A]", "K=2")
    path = write_file(tmp_path, "x.ini", "[Configuration]", "BasedOn=one.ini", "BasedOn=gone.ini")
    with pytest.raises(ConfigError, match=r"x\.ini:3: .*there is no .*gone\.ini"):
        IniFile(path)
