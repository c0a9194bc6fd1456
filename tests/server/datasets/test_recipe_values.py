"""Ranges and words of recipes."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.unreal_ini import parse_sections
from catoptra_server.datasets.recipe import ValueRange, read_range, read_words

DEFAULT = ValueRange(1.0, 2.0)


def section(line: str) -> SectionReader:
    """Section of one line."""
    (found,) = parse_sections(f"[Catoptra.X]\n{line}\n", file="recipe.ini")
    return SectionReader(found.name, SourceLocation("recipe.ini", 1), found.entries)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("Speed=3", ValueRange(3.0, 3.0)),
        ("Speed=(Min=-1,Max=4.5)", ValueRange(-1.0, 4.5)),
        ("Speed=(Min=2,Max=2)", ValueRange(2.0, 2.0)),
        ("Other=3", DEFAULT),
    ],
)
def test_range_is_a_struct_or_a_number(line: str, expected: ValueRange) -> None:
    assert read_range(section(line), "Speed", DEFAULT) == expected


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("Speed=(Min=2,Max=1)", "recipe.ini:2: Catoptra.X.Speed='(Min=2,Max=1)': .*Min at most"),
        ("Speed=(Min=0,Max=11)", "Speed.Max='11': expected a number from -5 to 10"),
        ("Speed=-6", "Speed='-6'"),
        ("Speed=(Min=0)", "Max"),
        ("Speed=fast", "Speed='fast'"),
    ],
)
def test_range_when_empty_or_out_of_bounds_is_an_error(line: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message.replace("(", r"\(").replace(")", r"\)")):
        read_range(section(line), "Speed", DEFAULT, min_value=-5.0, max_value=10.0)


def test_words_are_in_the_order_of_the_table() -> None:
    allowed = ("range", "ids", "flow")
    assert read_words(section("Channels=flow, Range"), "Channels", allowed, ()) == ("range", "flow")
    assert read_words(section("Channels=all"), "Channels", allowed, ()) == allowed
    assert read_words(section("Other=1"), "Channels", allowed, ("ids",)) == ("ids",)


def test_word_when_unknown_is_an_error_with_a_suggestion() -> None:
    with pytest.raises(ConfigError, match=r"recipe.ini:2: .*did you mean range\?"):
        read_words(section("Channels=ids,rnage"), "Channels", ("range", "ids"), ())
