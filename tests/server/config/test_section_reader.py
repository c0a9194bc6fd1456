"""Typed values of a section: errors with file, line, key and value; prefixes; unread keys."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import SectionReader, read_columns
from catoptra_server.config.unreal_ini import Entry
from helpers.configs import make_section


@pytest.mark.parametrize(
    ("text", "value"),
    [("1", 1.0), ("-.4", -0.4), ("0.14399984", 0.14399984), ("1e3", 1000.0), ("2.5f", 2.5)],
)
def test_number_when_written_as_in_real_files_is_read(text: str, value: float) -> None:
    assert make_section(f"K={text}").get_float("k") == value


@pytest.mark.parametrize("text", ["", "abc", "nan", "inf", "-inf", "+inf", "1e999", "1,5", "f"])
def test_number_when_malformed_names_file_line_key_and_value(text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        make_section(f"K={text}").get_float("K")
    error = caught.value
    assert (error.location, error.key, error.value) == (SourceLocation("x.ini", 2), "K", text)
    assert error.expected == "a number"


@pytest.mark.parametrize(("text", "expected"), [("-1", "from 0 to 10"), ("10.5", "from 0 to 10")])
def test_number_when_out_of_bounds_states_them(text: str, expected: str) -> None:
    with pytest.raises(ConfigError, match=f"x.ini:2: K='{text}': expected a number {expected}"):
        make_section(f"K={text}").get_float("K", min_value=0.0, max_value=10.0)


@pytest.mark.parametrize(
    ("read", "expected"),
    [
        (lambda s: s.get_float("K"), "a number"),
        (lambda s: s.get_float("K", min_value=1.0), "a number of at least 1"),
        (lambda s: s.get_float("K", max_value=1.0), "a number of at most 1"),
        (lambda s: s.get_float("K", min_value=0.5, max_value=10.0), "a number from 0.5 to 10"),
        (lambda s: s.get_int("K"), "a whole number of at least 0"),
    ],
)
def test_number_when_missing_states_its_bounds(
    read: Callable[[SectionReader], object], expected: str
) -> None:
    with pytest.raises(ConfigError, match=rf"x.ini:1: A.B.K=''.*{expected}; it is missing"):
        read(make_section())


def test_number_when_missing_is_its_default() -> None:
    assert make_section().get_float("K", 2.5) == 2.5


def test_number_when_repeated_is_the_last() -> None:
    assert make_section("K=1", "K=2").get_float("K") == 2.0


@pytest.mark.parametrize("text", ["1.5", "-1", "9", "x"])
def test_integer_when_malformed_is_rejected(text: str) -> None:
    with pytest.raises(ConfigError, match="a whole number from 0 to 8"):
        make_section(f"K={text}").get_int("K", max_value=8)


def test_integer_when_written_with_a_fraction_of_zero_is_read() -> None:
    assert make_section("K=4.0").get_int("K") == 4


@pytest.mark.parametrize(
    ("text", "value"), [("true", True), ("True", True), ("1", True), ("FALSE", False), ("0", False)]
)
def test_boolean_when_in_any_case_is_read(text: str, value: bool) -> None:
    assert make_section(f"K={text}").get_bool("K", not value) is value


def test_boolean_when_malformed_is_rejected() -> None:
    with pytest.raises(ConfigError, match="true or false"):
        make_section("K=yes").get_bool("K", False)


def test_choice_when_in_any_case_is_spelled_as_allowed() -> None:
    assert make_section("K=SKIDSTEERED").get_choice("K", ["SkidSteered"]) == "SkidSteered"


def test_choice_when_not_allowed_lists_what_is() -> None:
    with pytest.raises(ConfigError, match="one of y, z"):
        make_section("K=x").get_choice("K", ["y", "z"])


def test_vector_when_members_are_missing_takes_0_for_them() -> None:
    assert make_section("K=(y=2, X=1)").get_vector("K") == (1.0, 2.0, 0.0)


@pytest.mark.parametrize("text", ["1,2,3", "(X=1", "(X=a)"])
def test_vector_when_malformed_is_rejected_with_its_line(text: str) -> None:
    with pytest.raises(ConfigError, match=r"x\.ini:2"):
        make_section(f"K={text}").get_vector("K")


def test_vector_when_a_member_is_out_of_bounds_names_the_member() -> None:
    with pytest.raises(ConfigError, match=r"x\.ini:2: K\.Z='-1': expected a number from 0 to 9"):
        make_section("K=(X=1,Z=-1)").get_vector("K", min_value=0.0, max_value=9.0)


def test_file_when_it_exists_is_found_beside_the_ini(tmp_path: Path) -> None:
    (tmp_path / "a b").mkdir()
    (tmp_path / "a b" / "x.png").touch()
    assert make_section('K="a b\\x.png"').get_path("K", tmp_path) == tmp_path / "a b" / "x.png"


@pytest.mark.parametrize("name", ["missing.png", ".", "a\0b", "a\0b/c", "x" * 300])
def test_file_when_absent_is_rejected_with_its_line(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match=r"x\.ini:2: A\.B\.K=.*a file that exists"):
        make_section(f"K={name}").get_path("K", tmp_path)


def test_unknown_when_keys_and_members_were_not_read_lists_them() -> None:
    section = make_section("A=1", "B=2", "S=(X=1,W=2)")
    section.get_float("A")
    section.get_vector("S")
    assert [entry.key for entry in section.unknown_names()] == ["B", "W"]


@pytest.mark.parametrize(
    "read",
    [
        lambda s: s.get_str("A"),
        lambda s: s.get_int("A"),
        lambda s: s.get_bool("A", True),
        lambda s: s.get_choice("A", ["1"]),
        lambda s: s.get_wire_name("A"),
    ],
)
def test_unknown_when_a_key_was_read_omits_the_key(read: Callable[[SectionReader], object]) -> None:
    section = make_section("A=1")
    read(section)
    assert section.unknown_names() == []


def test_keys_when_ignored_are_not_reported() -> None:
    section = make_section("A=1", "B=2")
    section.get_float("A")
    assert [entry.key for entry in section.unknown_names()] == ["B"]
    section.ignore_all()
    assert section.unknown_names() == []


@pytest.mark.parametrize("text", ["1e10", "-1e10", "1e308"])
def test_number_when_beyond_all_bounds_is_rejected(text: str) -> None:
    with pytest.raises(ConfigError, match=r"K=.*a number, not beyond 1e\+09"):
        make_section(f"K={text}").get_float("K")


PROFILE = """# millimetres, of a measuring machine
radius, height
0, 5.0
10, 5.8

20, 8.2
30; 12.2
40\t17.8
"""


def read(folder: Path, content: str) -> tuple[tuple[float, ...], ...]:
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


def apply_lines(*lines: tuple[str, int]) -> SectionReader:
    """Section with lines of the list L: prefix and number."""
    return make_section(*(f"{prefix}L=(N={number})" for prefix, number in lines))


def list_numbers(section: SectionReader) -> list[int]:
    return [struct.get_int("N") for struct in section.get_structs("L")]


@pytest.mark.parametrize(
    ("lines", "numbers"),
    [
        ([("", 1), ("", 1)], [1, 1]),
        ([("", 1), (".", 1)], [1, 1]),
        ([("", 1), ("+", 1)], [1]),
        ([("+", 1), ("+", 1), ("+", 2)], [1, 2]),
        ([("", 1), ("", 2), ("", 1), ("-", 1), ("", 3)], [2, 3]),
        ([("", 1), ("-", 1), ("+", 1)], [1]),
        ([("-", 1), ("", 1)], [1]),
        ([("-", 1)], []),
        ([("", 1), ("!", 0), ("", 2)], [2]),
    ],
)
def test_list_when_changed_by_prefixes_follows_unreal(
    lines: list[tuple[str, int]], numbers: list[int]
) -> None:
    section = apply_lines(*lines)
    assert section.has_key("l") == bool(numbers)
    assert list_numbers(section) == numbers


@pytest.mark.parametrize(
    ("base", "derived", "numbers"),
    [
        ([("", 1)], [("", 2), ("", 3)], [2, 3]),
        ([("", 1)], [("+", 2), ("", 3)], [1, 2, 3]),
        ([("", 1)], [("+", 1)], [1]),
        ([("", 1), ("", 2)], [("-", 1)], [2]),
        ([("", 1)], [("!", 0)], []),
        ([("", 1)], [("!", 0), (".", 2)], [2]),
        ([("", 1)], [], [1]),
    ],
)
def test_overrides_when_derived_lines_have_prefixes_change_the_base(
    base: list[tuple[str, int]], derived: list[tuple[str, int]], numbers: list[int]
) -> None:
    section = apply_lines(*base)
    section.apply_overrides(apply_lines(*derived))
    assert list_numbers(section) == numbers


class CountedText(str):
    """Text that counts comparisons."""

    num_comparisons = 0

    __hash__ = str.__hash__

    def __eq__(self, other: object) -> bool:
        CountedText.num_comparisons += 1
        return str.__eq__(self, other)


def test_list_of_2000_values_compares_each_a_few_times() -> None:
    CountedText.num_comparisons = 0
    where = SourceLocation("x.ini", 1)
    lines = [Entry("K", CountedText(n), prefix, where) for prefix in "+-" for n in range(1000)]
    assert not SectionReader("A.B", where, lines).has_key("K")
    # A list that is searched for every line compares a million times.
    assert CountedText.num_comparisons <= 4000


def test_section_is_used_once_a_key_is_read_and_not_by_a_look() -> None:
    section = make_section("A=1")
    assert section.has_key("a")
    assert not section.is_used
    assert [name.key for name in section.unknown_names()] == ["A"]
    section.get_int("a")
    assert section.is_used


@pytest.mark.parametrize(
    ("key", "hint"), [("Radus", "; is Radius meant to be it?"), ("WheelBase", "")]
)
def test_key_when_missing_names_the_misspelt_unread_one(key: str, hint: str) -> None:
    with pytest.raises(ConfigError) as caught:
        make_section("Radius=1", "WheelBases=2", "-WheelBases=2").get_float(key)
    assert caught.value.expected == f"a number; it is missing{hint}"


@pytest.mark.parametrize("name", ["P2AT", "R1_left", "naïve", "a|b~c", "x" * 256])
def test_wire_name_when_valid_is_read(name: str) -> None:
    assert make_section(f"K={name}").get_wire_name("K") == name
    make_section(name=name).require_wire_name()


@pytest.mark.parametrize("name", ["two words", "a{b", "a}b", "a\tb", "€", "x" * 257])
def test_wire_name_when_invalid_is_rejected(name: str) -> None:
    with pytest.raises(ConfigError, match=r"x\.ini:2: A\.B\.K=.*one word"):
        make_section(f"K={name}").get_wire_name("K")
    with pytest.raises(ConfigError, match=r"x\.ini:1: section=.*one word"):
        make_section(name=name).require_wire_name()
