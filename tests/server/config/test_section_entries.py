"""Entries of a section: prefixes, derived sections, and which keys were read."""

from __future__ import annotations

import pytest

from catoptra_server.config.unreal_ini import SectionEntries, parse_sections


def make_entries(*lines: str) -> SectionEntries:
    (parsed,) = parse_sections("\n".join(("[A.B]", *lines)), file="x.ini")
    return SectionEntries(parsed.entries)


@pytest.mark.parametrize(
    ("lines", "values"),
    [
        (("L=1", "L=1"), [1, 1]),
        (("L=1", "+L=1"), [1]),
        (("L=1", "+L=2"), [1, 2]),
        (("L=1", ".L=1"), [1, 1]),
        (("L=1", "L=2", "-L=1"), [2]),
        (("L=1", "!L=", "L=2"), [2]),
        (("-L=1",), []),
    ],
)
def test_list_when_changed_by_prefixes_follows_unreal(
    lines: tuple[str, ...], values: list[int]
) -> None:
    assert [int(entry.value) for entry in make_entries(*lines).use("L")] == values


@pytest.mark.parametrize(
    ("base", "derived", "values"),
    [
        (("L=1",), ("L=2", "L=3"), [2, 3]),
        (("L=1",), ("+L=2", "L=3"), [1, 2, 3]),
        (("L=1",), ("+L=1",), [1]),
        (("L=1", "L=2"), ("-L=1",), [2]),
        (("L=1",), ("!L=",), []),
        (("L=1",), ("!L=", ".L=2"), [2]),
        (("L=1",), ("M=1",), [1]),
    ],
)
def test_overrides_when_derived_lines_have_prefixes_changes_the_base(
    base: tuple[str, ...], derived: tuple[str, ...], values: list[int]
) -> None:
    entries = make_entries(*base)
    entries.apply_overrides(make_entries(*derived))
    assert [int(entry.value) for entry in entries.use("L")] == values


def test_key_when_used_in_any_case_is_not_unread() -> None:
    entries = make_entries("A=1", "B=2")
    assert not entries.is_used
    entries.use("a")
    assert entries.is_used
    assert [name.key for name in entries.unread_names("A.B")] == ["B"]


def test_key_when_only_looked_up_stays_unread() -> None:
    entries = make_entries("A=1")
    assert entries.has_key("a")
    assert [name.key for name in entries.unread_names("A.B")] == ["A"]


@pytest.mark.parametrize(("key", "meant"), [("Radus", "Radius"), ("WheelBase", "")])
def test_key_when_missing_finds_the_misspelt_unread_one(key: str, meant: str) -> None:
    assert make_entries("Radius=1").find_misspelt(key) == meant
