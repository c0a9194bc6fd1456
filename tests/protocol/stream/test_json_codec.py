"""Messages of the stream as JSON: the same maps, readers and errors as in msgpack."""

from __future__ import annotations

import dataclasses
import json
import math

import pytest

from catoptra_protocol.errors import (
    InvalidRequestError,
    LocalProtocolError,
    RemoteProtocolError,
)
from catoptra_protocol.stream.codec import MAX_REPLY_BYTES, MAX_REQUEST_BYTES
from catoptra_protocol.stream.messages import (
    json_from_message,
    reply_from_json,
    request_from_json,
)
from catoptra_protocol.stream.replies import Reply, StateReply
from catoptra_protocol.stream.requests import (
    GetFrameRequest,
    ImageEncoding,
    PublishRequest,
    Request,
)
from helpers.stream_messages import HEADER, ROBOT_STATE, SAMPLE_REPLIES, SAMPLE_REQUESTS


@pytest.mark.parametrize("request_", SAMPLE_REQUESTS, ids=lambda m: m.KIND)
def test_request_when_encoded_and_decoded_is_equal(request_: Request) -> None:
    assert request_from_json(json_from_message(request_)) == request_


@pytest.mark.parametrize("reply", SAMPLE_REPLIES, ids=lambda m: m.KIND)
def test_reply_when_encoded_and_decoded_is_equal(reply: Reply) -> None:
    assert reply_from_json(json_from_message(reply)) == reply


def test_request_when_optional_fields_are_missing_has_their_defaults() -> None:
    text = '{"kind": "get_frame", "id": 1, "robot": "", "camera": "", "encoding": "jpeg"}'
    assert request_from_json(text) == GetFrameRequest(1, "", "", ImageEncoding.JPEG)


def test_message_when_encoded_begins_with_the_kind() -> None:
    assert next(iter(json.loads(json_from_message(HEADER)).items())) == ("kind", "frame")


@pytest.mark.parametrize(
    "text",
    [
        '{"kind": "fly", "id": 7}',
        '{"kind": "step", "id": 7}',
        '{"kind": "step", "id": 7, "time_s": "1"}',
        '{"id": 7}',
    ],
)
def test_request_when_a_field_is_wrong_is_rejected_with_its_id(text: str) -> None:
    with pytest.raises(InvalidRequestError) as caught:
        request_from_json(text)
    assert caught.value.request_id == 7


@pytest.mark.parametrize("id_", ["0", "-1", "1.0", "true", str(2**63), "null", '"1"', "NaN"])
def test_request_when_its_id_is_no_int_above_0_is_rejected_without_an_id(id_: str) -> None:
    with pytest.raises(RemoteProtocolError) as caught:
        request_from_json('{"kind": "get_status", "id": ' + id_ + "}")
    assert not isinstance(caught.value, InvalidRequestError)


@pytest.mark.parametrize("number", ["9" * 400, "1e400", "-1e999", "NaN", "Infinity", "9" * 5000])
def test_request_when_a_number_is_beyond_float64_is_rejected(number: str) -> None:
    text = '{"kind": "drive", "id": 7, "left": %s, "right": 0, "normalized": false}'
    with pytest.raises(RemoteProtocolError, match="no JSON"):
        request_from_json(text % number)


def test_request_when_it_holds_the_largest_note_fits() -> None:
    request = PublishRequest(1, "n" * 64, '{"text":"' + 8181 * "x" + '"}')
    assert len(request.text) == 8192
    assert request_from_json(json_from_message(request)) == request


def test_message_when_too_long_is_rejected() -> None:
    with pytest.raises(RemoteProtocolError, match="at most"):
        request_from_json(" " * (MAX_REQUEST_BYTES + 1))
    with pytest.raises(RemoteProtocolError, match="at most"):
        reply_from_json(" " * (MAX_REPLY_BYTES + 1))


def test_reply_when_its_kind_is_unknown_is_none() -> None:
    assert reply_from_json('{"kind": "forecast"}') is None


def test_reply_when_of_another_version_names_the_remedy() -> None:
    with pytest.raises(RemoteProtocolError, match=r"version 2 .*same release"):
        reply_from_json('{"kind": "frame", "version": 2}')


NOT_FINITE: list[Reply] = [
    dataclasses.replace(HEADER, age_s=math.nan),
    dataclasses.replace(HEADER, stage_ms={"trace": math.inf}),
    StateReply(
        *(1, 0.0, (dataclasses.replace(ROBOT_STATE, wheel_speeds_rad_s=(0.0, math.nan)),)),
        *("", (), ()),
    ),
]


@pytest.mark.parametrize("message", NOT_FINITE, ids=["field", "nested number", "nested tuple"])
def test_number_when_not_finite_is_not_sent(message: Reply) -> None:
    with pytest.raises(LocalProtocolError):
        json_from_message(message)
