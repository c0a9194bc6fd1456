"""Strict readers: a missing or wrong field is named."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.grammar import Message, parse_message

STATUS = Message("STA", (("Time", "1.5"), ("Battery", "1200"), ("Pose", "1,2,-3"), ("On", "True")))


def test_fields_when_well_formed_are_read() -> None:
    assert strict_fields.read_text(STATUS, "time") == "1.5"
    assert strict_fields.read_number(STATUS, "Time") == 1.5
    assert strict_fields.read_integer(STATUS, "Battery") == 1200
    assert strict_fields.read_vector(STATUS, "Pose") == (1.0, 2.0, -3.0)
    assert strict_fields.read_boolean(STATUS, "On") is True


def test_fields_when_missing_have_their_default() -> None:
    assert strict_fields.read_integer(STATUS, "View", default=-1) == -1
    assert strict_fields.read_boolean(STATUS, "Off") is False


def test_vectors_without_names_are_parsed_in_order() -> None:
    assert strict_fields.parse_vectors(STATUS, A="1,2,3", B="4,5,6") == (
        (1.0, 2.0, 3.0),
        (4.0, 5.0, 6.0),
    )


@pytest.mark.parametrize(
    "read",
    [
        strict_fields.read_text,
        strict_fields.read_number,
        strict_fields.read_integer,
        strict_fields.read_vector,
    ],
)
def test_fields_when_missing_are_named(read: object) -> None:
    assert callable(read)
    with pytest.raises(RemoteProtocolError, match=r"STA without \{View\}"):
        read(STATUS, "View")


@pytest.mark.parametrize("value", ["", "x", "nan", "inf", "1 2", "1e999"])
def test_number_when_malformed_is_quoted(value: str) -> None:
    with pytest.raises(RemoteProtocolError, match="expected a finite number"):
        strict_fields.read_number(Message("STA", (("Time", value),)), "Time")


def test_error_when_the_line_is_long_quotes_its_start() -> None:
    with pytest.raises(RemoteProtocolError) as caught:
        strict_fields.read_number(Message("STA", (("Time", "x" * 60_000),)), "Time")
    assert len(str(caught.value)) < 500


def test_numbers_of_any_count_are_read() -> None:
    assert strict_fields.read_numbers(parse_message("SEN {Range 1,2.5,-3}"), "Range") == (
        1.0,
        2.5,
        -3.0,
    )
    with pytest.raises(RemoteProtocolError, match="finite"):
        strict_fields.read_numbers(parse_message("SEN {Range 1,,3}"), "Range")


def test_optional_number_when_missing_is_none_but_when_wrong_is_rejected() -> None:
    assert strict_fields.read_optional_number(parse_message("SEN {A b}"), "Time") is None
    with pytest.raises(RemoteProtocolError, match="Time x"):
        strict_fields.read_optional_number(parse_message("SEN {Time x}"), "Time")
