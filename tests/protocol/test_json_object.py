"""JSON objects of peers: every text is decoded or rejected, within limits."""

from __future__ import annotations

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.json_object import (
    MAX_JSON_DEPTH,
    json_object_from_text,
    text_from_json_object,
)

LIMIT = 1000

REJECTED = {
    "nothing": ("", "no JSON"),
    "cut": ('{"a": [1', "no JSON"),
    "a list": ("[]", r"JSON that is \[\]: expected an object"),
    "a text": ('"a"', "expected an object"),
    "a number": ("1", "expected an object"),
    "two objects": ("{}{}", "no JSON"),
    "a byte order mark": ("\ufeff{}", "no JSON"),
    "NaN": ('{"a": NaN}', "NaN: expected a finite number"),
    "nested infinity": ('{"a": [{"b": -Infinity}]}', "-Infinity: expected a finite number"),
    "beyond float64": ('{"a": [{"b": 1e999}]}', "float64"),
    "an int beyond float64": ('{"a": ' + "9" * 400 + "}", "an int of 400 characters"),
    "an int of many digits": ('{"a": -' + "9" * 5000 + "}", "JSON|at most"),
    "a name twice": ('{"a": 1, "a": 2}', "one name twice"),
    "a nested name twice": ('{"a": [{"b": 1, "b": 1}]}', "one name twice"),
    "an unpaired surrogate": (r'{"a": "\ud800"}', "unpaired surrogate"),
    "a nested unpaired surrogate": (r'{"a": [{"\udfff": 1}]}', "unpaired surrogate"),
    "an unpaired surrogate as character": ('{"a": "\ud800"}', "unpaired surrogate"),
    "a control character": ('{"a": "\n"}', "no JSON"),
    "lists without end": ('{"a": ' + "[" * 900, "no JSON|nested"),
    "deep lists": ('{"a":' + 16 * "[" + 16 * "]" + "}", "more than 16 nested"),
    "deep objects": (17 * '{"a":' + "1" + 17 * "}", "more than 16 nested"),
}


@pytest.mark.parametrize(("text", "message"), REJECTED.values(), ids=REJECTED.keys())
def test_text_when_no_object_within_limits_is_rejected_with_its_reason(
    text: str, message: str
) -> None:
    with pytest.raises(RemoteProtocolError, match=message):
        json_object_from_text(text, LIMIT)


def test_text_when_of_giant_depth_is_rejected() -> None:
    depth = 100_000
    text = '{"a":' + depth * "[" + depth * "]" + "}"
    with pytest.raises(RemoteProtocolError, match="nested"):
        json_object_from_text(text, len(text))


def test_object_when_as_deep_as_allowed_is_decoded() -> None:
    levels = MAX_JSON_DEPTH - 1
    assert json_object_from_text('{"a":' + levels * "[" + levels * "]" + "}", LIMIT)


@pytest.mark.parametrize("text", ["x" * 498, "\u00e4" * 249], ids=["ASCII", "two bytes each"])
def test_text_when_one_byte_too_long_is_rejected(text: str) -> None:
    whole = f'{{"a":"{text}"}}'
    size = len(whole.encode())
    assert json_object_from_text(whole, size) == {"a": text}
    with pytest.raises(RemoteProtocolError, match=f"at most {size - 1} are read"):
        json_object_from_text(whole, size - 1)


def test_object_when_encoded_and_decoded_is_equal() -> None:
    fields = {"a": [1, 2.5, None, True], "b": {"c": "\u00e4\U0001f600\n"}}
    assert json_object_from_text(text_from_json_object(fields), LIMIT) == fields


@pytest.mark.parametrize(
    "value", [math.nan, [math.inf], {"b": (-math.inf,)}, b"", {1, 2}], ids=repr
)
def test_value_when_not_of_json_is_not_encoded(value: object) -> None:
    with pytest.raises(LocalProtocolError, match="no JSON object"):
        text_from_json_object({"a": value})


def test_value_when_it_contains_itself_is_not_encoded() -> None:
    endless: list[object] = []
    endless.append(endless)
    with pytest.raises(LocalProtocolError, match="no JSON object"):
        text_from_json_object({"a": endless})


@given(st.text(max_size=60))
def test_any_text_is_decoded_or_rejected(text: str) -> None:
    with contextlib.suppress(RemoteProtocolError):
        assert isinstance(json_object_from_text(text, LIMIT), dict)
