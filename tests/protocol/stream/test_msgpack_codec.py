"""The door to msgpack: what is refused, by name, and before memory is taken."""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass
from enum import Enum

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.stream.msgpack_codec import (
    dataclass_from_fields,
    pack,
    read_str_field,
    unpack,
)

LIMIT = 1000


class Colour(Enum):
    """Two of them."""

    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True, slots=True)
class NestedFields:
    """A part."""

    size: int


@dataclass(frozen=True, slots=True)
class AllFieldTypes:
    """One field of each sort that is read."""

    whole: int
    number: float
    text: str
    flag: bool
    maybe: float | None
    three: tuple[float, float, float]
    some: tuple[NestedFields, ...]
    table: dict[str, float]
    colour: Colour
    inner: NestedFields


ALL_FIELD_TYPES = AllFieldTypes(
    *(1, 2.5, "a", True, None, (1.0, 2.0, 3.0), (NestedFields(4), NestedFields(5)), {"x": 6.0}),
    *(Colour.BLUE, NestedFields(7)),
)
FIELDS = unpack(pack("form", ALL_FIELD_TYPES), LIMIT)


def test_dataclass_when_packed_and_read_is_itself() -> None:
    assert dataclass_from_fields(AllFieldTypes, FIELDS) == ALL_FIELD_TYPES
    assert read_str_field(FIELDS, "kind") == "form"


def test_fields_when_unknown_are_ignored() -> None:
    assert dataclass_from_fields(AllFieldTypes, {**FIELDS, "new": [1, 2]}) == ALL_FIELD_TYPES


@pytest.mark.parametrize("name", [name for name in FIELDS if name != "kind"])
def test_field_when_missing_is_refused_with_its_name(name: str) -> None:
    fields = {key: value for key, value in FIELDS.items() if key != name}
    with pytest.raises(RemoteProtocolError, match=f"Form without the field '{name}'"):
        dataclass_from_fields(AllFieldTypes, fields)


WRONG = [
    ("whole", 1.0, "whole: 1.0: expected a whole number"),
    ("whole", True, "whole: True"),
    ("whole", 2**64 - 1, "63 bits"),
    ("number", "2", "number: '2': expected a finite number"),
    ("number", math.nan, "finite"),
    ("text", 3, "text: 3: expected a text"),
    ("flag", 0, "flag: 0: expected true or false"),
    ("three", [1, 2], "three: .*expected a list of 3"),
    ("three", [1, 2, "3"], r"three\[2\]: '3'"),
    ("some", [{"size": 1}, {}], r"some\[1\] without the field 'size'"),
    ("some", 7, "some: 7: expected a list"),
    ("table", {"x": "y"}, r"table\.x: 'y'"),
    ("colour", "green", "colour: 'green': expected one of red, blue"),
    ("colour", [1], "colour"),
    ("inner", None, "inner: None: expected a map"),
    ("inner", {}, "inner without the field 'size'"),
]


@pytest.mark.parametrize(("name", "value", "said"), WRONG)
def test_field_when_wrong_is_refused_with_name_value_and_expectation(
    name: str, value: object, said: str
) -> None:
    with pytest.raises(RemoteProtocolError, match=said):
        dataclass_from_fields(AllFieldTypes, {**FIELDS, name: value})


BAD = {
    "nothing": b"",
    "cut": b"\x81\xa1",
    "a list": b"\x90",
    "two objects": b"\x80\x80",
    "never used byte": b"\xc1",
    "no utf-8": b"\x81\xa1\xff\x01",
    "a huge map announced": b"\xdf\xff\xff\xff\xff",
    "a huge list announced": b"\x81\xa1a\xdd\xff\xff\xff\xff",
    "a huge text announced": b"\x81\xa1a\xdb\xff\xff\xff\xff",
    "binary": b"\x81\xa1a\xc4\x01a",
    "an extension": b"\x81\xa1a\xd4\x01a",
    "a timestamp": b"\x81\xa1a\xd6\xff\0\0\0\0",
    "nested without end": b"\x91" * 900,
    "a list as key": b"\x81\x90\x01",
}


@pytest.mark.parametrize("data", BAD.values(), ids=BAD.keys())
def test_bytes_when_not_a_map_within_limits_are_refused(data: bytes) -> None:
    with pytest.raises(RemoteProtocolError):
        unpack(data, LIMIT)


def test_bytes_when_too_many_are_refused_unread() -> None:
    with pytest.raises(RemoteProtocolError, match="1001 bytes: at most 1000"):
        unpack(bytes(LIMIT + 1), LIMIT)


def test_number_when_not_finite_is_not_sent() -> None:
    with pytest.raises(LocalProtocolError, match=r"Bad\.number"):
        pack("bad", _non_finite_message())


def _non_finite_message() -> object:
    @dataclass(frozen=True)
    class Bad:
        number: float

    return Bad(math.inf)


def test_text_when_missing_is_named() -> None:
    with pytest.raises(RemoteProtocolError, match="'kind'"):
        read_str_field({}, "kind")


@given(st.binary(max_size=60))
def test_any_bytes_are_read_or_refused(data: bytes) -> None:
    check_read_or_rejection(data)


VALUES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.integers(-9, 2**63),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=8,
)


@given(st.dictionaries(st.sampled_from(sorted(FIELDS)), VALUES))
def test_any_map_is_read_or_refused(changes: dict[str, object]) -> None:
    check_read_or_rejection(msgpack.packb({**FIELDS, **changes}))


def check_read_or_rejection(data: bytes) -> None:
    """Read a form; fail for any error but the one that is meant."""
    with contextlib.suppress(RemoteProtocolError):
        assert isinstance(dataclass_from_fields(AllFieldTypes, unpack(data, LIMIT)), AllFieldTypes)
