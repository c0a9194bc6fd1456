"""All messages of the ZeroMQ stream: round trips, and the rejection of every missing field."""

from __future__ import annotations

import dataclasses
from typing import get_args

import msgpack
import pytest

from catoptra_protocol.errors import (
    InvalidRequestError,
    LocalProtocolError,
    RemoteProtocolError,
)
from catoptra_protocol.stream.codec import MAX_REPLY_BYTES, MAX_REQUEST_BYTES, FieldMap
from catoptra_protocol.stream.messages import (
    SCHEMA_VERSION,
    bytes_from_message,
    reply_from_bytes,
    request_from_bytes,
)
from catoptra_protocol.stream.replies import REPLIES, Reply
from catoptra_protocol.stream.requests import REQUESTS, Request
from helpers.stream_messages import SAMPLE_REPLIES, SAMPLE_REQUESTS

MESSAGES = [*SAMPLE_REQUESTS, *SAMPLE_REPLIES]
FIELDS = [(message, field) for message in MESSAGES for field in dataclasses.fields(message)]
OPTIONAL_FIELDS = [(m, f) for m, f in FIELDS if f.default is not dataclasses.MISSING]
MISSING = [(m, field.name) for m, field in FIELDS if field.default is dataclasses.MISSING]


def decode(data: bytes) -> Request | Reply | None:
    """Decode a message of either side."""
    if msgpack.unpackb(data)["kind"] in REQUESTS:
        return request_from_bytes(data)
    return reply_from_bytes(data)


def test_tables_hold_every_member_of_their_union() -> None:
    assert set(REQUESTS.values()) == set(get_args(Request))
    assert set(REPLIES.values()) == set(get_args(Reply))


def test_samples_are_all_messages() -> None:
    assert {type(sample) for sample in SAMPLE_REQUESTS} == set(REQUESTS.values())
    assert {type(sample) for sample in SAMPLE_REPLIES} == set(REPLIES.values())


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.KIND)
def test_message_when_encoded_and_decoded_is_equal(message: Request | Reply) -> None:
    assert decode(bytes_from_message(message)) == message


@pytest.mark.parametrize(
    ("message", "field"), OPTIONAL_FIELDS, ids=lambda x: getattr(x, "KIND", None) or x.name
)
def test_field_when_optional_and_missing_has_its_default(
    message: Request | Reply, field: dataclasses.Field[object]
) -> None:
    fields = msgpack.unpackb(bytes_from_message(message))
    del fields[field.name]
    assert getattr(decode(msgpack.packb(fields)), field.name) == field.default


@pytest.mark.parametrize(("message", "name"), MISSING, ids=lambda x: getattr(x, "KIND", x))
def test_field_when_missing_is_rejected_with_its_name(message: Request | Reply, name: str) -> None:
    fields = msgpack.unpackb(bytes_from_message(message))
    del fields[name]
    with pytest.raises(RemoteProtocolError, match=f"'{name}'"):
        decode(msgpack.packb(fields))


def test_request_when_its_kind_is_unknown_lists_the_known_kinds() -> None:
    with pytest.raises(RemoteProtocolError, match=r"'fly'.*get_frame"):
        request_from_bytes(msgpack.packb({"kind": "fly"}))


@pytest.mark.parametrize("fields", [{"kind": "fly"}, {"kind": "step"}, {}, {"kind": 1}])
def test_request_when_another_field_is_wrong_is_rejected_with_its_id(fields: FieldMap) -> None:
    with pytest.raises(InvalidRequestError) as caught:
        request_from_bytes(msgpack.packb({**fields, "id": 7}))
    assert caught.value.request_id == 7


@pytest.mark.parametrize("id_", [0, -1, 1.0, True, 2**63, None, "1"])
@pytest.mark.parametrize("kind", ["get_status", "fly"])
def test_request_when_its_id_is_no_int_above_0_is_rejected_without_an_id(
    kind: str, id_: object
) -> None:
    with pytest.raises(RemoteProtocolError, match=r"id|kind") as caught:
        request_from_bytes(msgpack.packb({"kind": kind, "id": id_}))
    assert not isinstance(caught.value, InvalidRequestError)


def test_reply_when_its_kind_is_unknown_is_none() -> None:
    assert reply_from_bytes(msgpack.packb({"kind": "forecast"})) is None


def test_reply_when_of_another_version_names_the_remedy() -> None:
    with pytest.raises(RemoteProtocolError, match=f"version 2 .* this client {SCHEMA_VERSION}"):
        reply_from_bytes(msgpack.packb({"kind": "frame", "version": 2}))


def test_message_when_too_long_is_rejected() -> None:
    with pytest.raises(RemoteProtocolError, match="at most"):
        request_from_bytes(bytes(MAX_REQUEST_BYTES + 1))
    with pytest.raises(RemoteProtocolError, match="at most"):
        reply_from_bytes(bytes(MAX_REPLY_BYTES + 1))


def test_header_when_not_finite_is_not_sent() -> None:
    header = dataclasses.replace(SAMPLE_REPLIES[0], age_s=float("nan"))  # type: ignore[type-var, call-arg] # the first is the header
    with pytest.raises(LocalProtocolError, match="age_s"):
        bytes_from_message(header)
