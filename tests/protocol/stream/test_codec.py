"""Dataclasses as maps, and maps as msgpack."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
from dataclasses import dataclass
from enum import Enum

import msgpack
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.stream.codec import (
    dataclass_from_fields,
    fields_from_message,
    pack,
    plain_value,
    read_str_field,
    unpack,
)
from helpers.stream_messages import HEADER


class Colour(Enum):
    """An enum with two members."""

    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True, slots=True)
class NestedFields:
    """A nested dataclass."""

    size: int


@dataclass(frozen=True, slots=True)
class AllFieldTypes:
    """One field of each supported type."""

    an_int: int
    a_float: float
    a_str: str
    a_bool: bool
    optional: float | None
    triple: tuple[float, float, float]
    items: tuple[NestedFields, ...]
    table: dict[str, float]
    colour: Colour
    nested: NestedFields


ALL_FIELD_TYPES = AllFieldTypes(
    *(1, 2.5, "a", True, None, (1.0, 2.0, 3.0), (NestedFields(4), NestedFields(5)), {"x": 6.0}),
    *(Colour.BLUE, NestedFields(7)),
)
FIELDS = json.loads(json.dumps(fields_from_message("sample", ALL_FIELD_TYPES), default=plain_value))


def test_dataclass_when_read_from_its_map_is_equal() -> None:
    assert dataclass_from_fields(AllFieldTypes, FIELDS) == ALL_FIELD_TYPES
    assert read_str_field(FIELDS, "kind") == "sample"


def test_fields_when_unknown_are_ignored() -> None:
    assert dataclass_from_fields(AllFieldTypes, {**FIELDS, "new": [1, 2]}) == ALL_FIELD_TYPES


@pytest.mark.parametrize("name", [name for name in FIELDS if name != "kind"])
def test_field_when_missing_is_rejected_with_its_name(name: str) -> None:
    fields = {key: value for key, value in FIELDS.items() if key != name}
    with pytest.raises(RemoteProtocolError, match=f"AllFieldTypes without the field '{name}'"):
        dataclass_from_fields(AllFieldTypes, fields)


WRONG = [
    ("an_int", 1.0, "an_int: 1.0: expected an int"),
    ("an_int", True, "an_int: True"),
    ("an_int", 2**64 - 1, "63 bits"),
    ("a_float", "2", "a_float: '2': expected a finite number"),
    ("a_float", math.nan, "finite"),
    ("a_str", 3, "a_str: 3: expected a str"),
    ("a_bool", 0, "a_bool: 0: expected a bool"),
    ("triple", [1, 2], "triple: .*expected a list of 3"),
    ("triple", [1, 2, "3"], r"triple\[2\]: '3'"),
    ("items", [{"size": 1}, {}], r"items\[1\] without the field 'size'"),
    ("items", 7, "items: 7: expected a list"),
    ("table", {"x": "y"}, r"table\.x: 'y'"),
    ("colour", "green", "colour: 'green': expected one of red, blue"),
    ("colour", [1], "colour"),
    ("nested", None, "nested: None: expected a map"),
    ("nested", {}, "nested without the field 'size'"),
]


@pytest.mark.parametrize(("name", "value", "expected_message"), WRONG)
def test_field_when_wrong_is_rejected_with_name_value_and_expectation(
    name: str, value: object, expected_message: str
) -> None:
    with pytest.raises(RemoteProtocolError, match=expected_message):
        dataclass_from_fields(AllFieldTypes, {**FIELDS, name: value})


def test_text_when_missing_is_named() -> None:
    with pytest.raises(RemoteProtocolError, match="'kind'"):
        read_str_field({}, "kind")


VALUES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5) | st.integers(-9, 2**63),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner),
    max_leaves=8,
)


# On a loaded machine drawing nested values takes long enough for the check, which counts wall time.
@settings(derandomize=True, suppress_health_check=[HealthCheck.too_slow], deadline=None)
@given(st.dictionaries(st.sampled_from(sorted(FIELDS)), VALUES))
def test_any_map_is_decoded_or_rejected(changes: dict[str, object]) -> None:
    with contextlib.suppress(RemoteProtocolError):
        sample = dataclass_from_fields(AllFieldTypes, {**FIELDS, **changes})
        assert isinstance(sample, AllFieldTypes)


LIMIT = 1000


MALFORMED = {
    "nothing": b"",
    "cut": b"\x81\xa1",
    "a list": b"\x90",
    "two objects": b"\x80\x80",
    "never used byte": b"\xc1",
    "no utf-8": b"\x81\xa1\xff\x01",
    "length of a huge map": b"\xdf\xff\xff\xff\xff",
    "length of a huge list": b"\x81\xa1a\xdd\xff\xff\xff\xff",
    "length of a huge str": b"\x81\xa1a\xdb\xff\xff\xff\xff",
    "binary": b"\x81\xa1a\xc4\x01a",
    "an extension": b"\x81\xa1a\xd4\x01a",
    "a timestamp": b"\x81\xa1a\xd6\xff\0\0\0\0",
    "nested without end": b"\x91" * 900,
    "a list as key": b"\x81\x90\x01",
}


@pytest.mark.parametrize("data", MALFORMED.values(), ids=MALFORMED.keys())
def test_bytes_when_not_a_map_within_limits_are_rejected(data: bytes) -> None:
    with pytest.raises(RemoteProtocolError):
        unpack(data, LIMIT)


def test_bytes_when_too_many_are_rejected_undecoded() -> None:
    with pytest.raises(RemoteProtocolError, match="1001 bytes: at most 1000"):
        unpack(bytes(LIMIT + 1), LIMIT)


def test_number_when_not_finite_is_not_sent() -> None:
    with pytest.raises(LocalProtocolError, match=r"FrameHeader\.age_s"):
        pack("frame", dataclasses.replace(HEADER, age_s=math.inf))


@given(st.binary(max_size=60))
def test_any_bytes_are_decoded_or_rejected(data: bytes) -> None:
    with contextlib.suppress(RemoteProtocolError):
        assert isinstance(unpack(data, LIMIT), dict)


def test_fields_when_packed_begin_with_the_kind() -> None:
    assert next(iter(msgpack.unpackb(pack("frame", HEADER)).items())) == ("kind", "frame")
