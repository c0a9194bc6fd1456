"""The grammar of Unreal's ini files, with the oddities of real ones."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import ConfigError
from catoptra_server.config import unreal_ini
from catoptra_server.config.unreal_ini import (
    Section,
    parse_sections,
    parse_struct,
    read_sections,
    unquote,
)

MAX_FILE_LINES = 65536


def parse_entries(*lines: str) -> list[tuple[str, str, str]]:
    """(operator, key, value) of the lines of one section."""
    (section,) = parse_sections("\n".join(("[A.B]", *lines)), file="x.ini")
    return [(entry.operator, entry.key, entry.value) for entry in section.entries]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("Key=value", ("", "Key", "value")),
        ("dropCheckFrequency = 5", ("", "dropCheckFrequency", "5")),
        ("beamAngle=0.349;", ("", "beamAngle", "0.349")),
        ("K=11.5 ; the paper's", ("", "K", "11.5")),
        ('Name="a;b" ; c', ("", "Name", '"a;b"')),
        ('Name="x;y";z', ("", "Name", '"x;y"')),
        ("Key=", ("", "Key", "")),
        ("A=b=c", ("", "A", "b=c")),
        ("Key[0]=1", ("", "Key[0]", "1")),
        ("+Paths=x", ("+", "Paths", "x")),
        (".Paths=x", (".", "Paths", "x")),
        ("-Paths=x", ("-", "Paths", "x")),
        ("!Paths=", ("!", "Paths", "")),
    ],
)
def test_entry_when_written_as_in_real_files_is_read(
    line: str, expected: tuple[str, str, str]
) -> None:
    assert parse_entries(line) == [expected]


def test_comments_and_blank_lines_are_no_entries() -> None:
    assert parse_entries("", "; a comment", "   ", ";Key=value") == []


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_lines_when_ended_in_any_way_are_counted_alike(end: str) -> None:
    (section,) = parse_sections(end.join(("; c", "[A.B]", "", "K=1", "")), file="x.ini")
    assert (section.where.line, section.entries[0].where.line) == (2, 4)


@pytest.mark.parametrize("odd", ["\f", "\v", "\x1c", "\x85", "\u2028"])
def test_line_when_it_holds_an_odd_separator_goes_on(odd: str) -> None:
    assert parse_entries(f"A=1 ; a{odd}b") == [("", "A", "1")]


def test_section_when_repeated_is_kept_apart() -> None:
    sections = parse_sections("[A]\nK=1\n[B]\n[A]\nK=2\n", file="x.ini")
    assert [(s.name, len(s.entries)) for s in sections] == [("A", 1), ("B", 0), ("A", 1)]


@pytest.mark.parametrize(
    ("text", "line", "expected"),
    [
        ("Key=1\n", 1, "a [Package.Class] first"),
        ("[A]\n\nnonsense\n", 3, "key=value"),
        ("[A]\n=1\n", 2, "key=value"),
        ("[A]\n+=1\n", 2, "key=value"),
        ("[A\n", 1, "[Package.Class]"),
        ("[]\n", 1, "[Package.Class]"),
        ("[A] tail\n", 1, "[Package.Class]"),
    ],
)
def test_text_when_broken_names_file_and_line(text: str, line: int, expected: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_sections(text, file="x.ini")
    assert (caught.value.location.file, caught.value.location.line) == ("x.ini", line)
    assert expected in str(caught.value)


@pytest.mark.parametrize(
    ("value", "members"),
    [
        ("()", []),
        ("(X=1,Y=2)", [("X", "1"), ("Y", "2")]),
        ("( X = 1 , Y = 2 )", [("X", "1"), ("Y", "2")]),
        ("(X=1,)", [("X", "1")]),
        ("(A=(X=1,Y=(Z=2)),B=3)", [("A", "(X=1,Y=(Z=2))"), ("B", "3")]),
        ('(N="a,b)c",M=1)', [("N", '"a,b)c"'), ("M", "1")]),
        ("(C=class'USARBot.P2AT')", [("C", "class'USARBot.P2AT'")]),
        ("(X=0,Y=-0.2)'was y=-1.2", [("X", "0"), ("Y", "-0.2")]),
    ],
)
def test_struct_when_well_formed_gives_its_members(
    value: str, members: list[tuple[str, str]]
) -> None:
    assert parse_struct(value) == members


@pytest.mark.parametrize("value", ["", "1", "(X=1", "((X=1)", '(X="1)', "(1,2)", "(=1)"])
def test_struct_when_unbalanced_or_unnamed_is_none(value: str) -> None:
    assert parse_struct(value) is None


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ('"quoted"', "quoted"),
        ('""', ""),
        ("class'USARSensor.SICK'", "USARSensor.SICK"),
        ("bare", "bare"),
        ('"', '"'),
        ("it's", "it's"),
    ],
)
def test_value_when_quoted_or_a_reference_is_unquoted(value: str, text: str) -> None:
    assert unquote(value) == text


def test_file_when_it_starts_with_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    path = tmp_path / "x.ini"
    path.write_bytes(b"\xef\xbb\xbf[A]\r\nK=1\r\n")
    assert read_sections(path)[0].entries[0].key == "K"


def test_file_when_not_utf_8_names_the_line_of_the_byte(tmp_path: Path) -> None:
    path = tmp_path / "x.ini"
    path.write_bytes("[A]\nK=1\nN=Zürich\n".encode("latin-1"))
    with pytest.raises(ConfigError, match=r"x\.ini:3.*UTF-8"):
        read_sections(path)


def test_file_when_of_5_mb_is_rejected_unread(tmp_path: Path) -> None:
    path = tmp_path / "x.ini"
    path.write_bytes(b";" * 5_000_000)
    with pytest.raises(ConfigError, match="a smaller ini file: at most 4194304 bytes"):
        read_sections(path)


@pytest.mark.parametrize("name", ["missing.ini", ".", "a\0b"])
def test_file_when_unreadable_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError, match="a readable ini file"):
        read_sections(tmp_path / name)


def test_section_of_2000_lines_is_made_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made = []

    def make_section(*arguments: object) -> Section:
        made.append(arguments)
        return Section(*arguments)  # type: ignore[arg-type] # as given by the module

    monkeypatch.setattr(unreal_ini, "Section", make_section)
    (section,) = parse_sections("[A]\n" + 2000 * "K=1\n", file="x.ini")
    assert len(section.entries) == 2000
    # A section that is copied for each line takes time with the square of its length.
    assert len(made) == 1


@pytest.mark.parametrize("end", ["", "\n", "\n\n  "])
def test_text_of_just_the_largest_number_of_lines_is_read(end: str) -> None:
    lines = ["[A]", *(MAX_FILE_LINES - 1) * ["K=1"]]
    (section,) = parse_sections("\n".join(lines) + end, file="x.ini")
    assert len(section.entries) == MAX_FILE_LINES - 1


def test_text_of_more_lines_is_rejected_at_the_next() -> None:
    lines = ["[A]", *MAX_FILE_LINES * ["K=1"]]
    with pytest.raises(ConfigError, match=r"x\.ini:65537: .*at most 65536 lines"):
        parse_sections("\n".join(lines), file="x.ini")


def keys_or_error(text: str) -> tuple[list[str], ConfigError | None]:
    try:
        sections = parse_sections(text, file="x.ini")
    except ConfigError as error:
        return [], error
    return [entry.key for section in sections for entry in section.entries], None


@settings(derandomize=True, max_examples=300, deadline=None)
@given(st.text(alphabet=st.sampled_from("[]()=,;\"'+-.! \n\raK1\u00e9"), max_size=60))
def test_text_when_arbitrary_is_read_or_rejected_with_a_line(text: str) -> None:
    keys, error = keys_or_error(text)
    assert all(keys)
    assert error is None or error.location.line >= 1


@settings(derandomize=True, max_examples=300, deadline=None)
@given(st.text(alphabet=st.sampled_from("()=,\"'aX1 "), max_size=40))
def test_struct_when_arbitrary_has_named_members_or_is_none(value: str) -> None:
    assert all(name for name, _ in parse_struct(value) or [])
