"""Fields of a command: lenient parsing, exact output."""

from __future__ import annotations

import math

import pytest

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.limits import MAX_COMMAND_NUMBER, MAX_NAME_CHARS
from catoptra_protocol.usarsim import lenient_fields as fields
from catoptra_protocol.usarsim.grammar import parse_message

MESSAGE = parse_message("X {Text abc} {Number -1.9} {On 1} {Place 1, 2,3} {Wrong up}")


def test_fields_when_missing_are_none() -> None:
    readers = (
        fields.read_name,
        fields.read_text,
        fields.read_number,
        fields.read_set_point,
        fields.read_integer,
        fields.read_boolean,
        fields.read_vector,
    )
    assert [reader(MESSAGE, "Missing") for reader in readers] == [None] * 7


def test_fields_when_present_are_read() -> None:
    assert fields.read_name(MESSAGE, "text") == "abc"
    assert fields.read_number(MESSAGE, "NUMBER") == -1.9
    assert fields.read_set_point(MESSAGE, "NUMBER") == -1.9
    assert fields.read_integer(MESSAGE, "Number") == -1
    assert fields.read_boolean(MESSAGE, "On") is True
    assert fields.read_vector(MESSAGE, "Place") == (1.0, 2.0, 3.0)


def test_fields_that_are_no_numbers_are_zero() -> None:
    assert fields.read_number(MESSAGE, "Wrong") == 0.0
    assert fields.read_integer(MESSAGE, "Wrong") == 0
    assert fields.read_vector(MESSAGE, "Wrong") == (0.0, 0.0, 0.0)


def test_name_when_too_long_is_truncated() -> None:
    assert fields.read_name(parse_message("X {A " + "n" * 999 + "}"), "A") == "n" * MAX_NAME_CHARS


def test_name_when_it_has_control_characters_has_question_marks() -> None:
    message = parse_message("X {A a\x1b[31m\tb\x7f\x9bJ\xfcrgen}")
    assert fields.read_name(message, "A") == "a?[31m?b??J\xfcrgen"


@pytest.mark.parametrize("text", ["1.1e9", "-1.1e9", "1e300", "1e999", "-" + 400 * "9"])
def test_set_point_when_beyond_the_limit_is_a_remote_error(text: str) -> None:
    message = parse_message(f"X {{A {text}}} {{B {MAX_COMMAND_NUMBER:f}}}")
    assert fields.read_set_point(message, "B") == MAX_COMMAND_NUMBER
    for read in (fields.read_set_point, fields.read_integer):
        with pytest.raises(RemoteProtocolError, match="the limit is"):
            read(message, "A")


def test_format_pairs_skips_values_that_are_none() -> None:
    pairs = fields.format_pairs(
        ("A", None), ("B", True), ("C", 1e-7), ("D", 3), ("E", (1.0, 2.0, 0.5))
    )
    assert pairs == (("B", "true"), ("C", "0.0000001"), ("D", "3"), ("E", "1.0,2.0,0.5"))


def test_format_pairs_when_a_number_is_not_finite_raises() -> None:
    with pytest.raises(LocalProtocolError, match="finite"):
        fields.format_pairs(("A", math.nan))
