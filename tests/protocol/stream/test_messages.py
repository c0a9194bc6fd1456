"""All messages of the modern stream: round trips, and the refusal of every missing field."""

from __future__ import annotations

import dataclasses

import msgpack
import pytest

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.stream.messages import (
    SCHEMA_VERSION,
    bytes_from_message,
    reply_from_bytes,
    request_from_bytes,
)
from catoptra_protocol.stream.msgpack_codec import MAX_REPLY_BYTES, MAX_REQUEST_BYTES
from catoptra_protocol.stream.replies import REPLIES, Reply
from catoptra_protocol.stream.requests import REQUESTS, Request
from helpers.stream_messages import SAMPLE_REPLIES, SAMPLE_REQUESTS

MESSAGES = [*SAMPLE_REQUESTS, *SAMPLE_REPLIES]
FIELDS = [(message, field) for message in MESSAGES for field in dataclasses.fields(message)]
OPTIONAL_FIELDS = [(m, field.name) for m, field in FIELDS if field.default is None]
MISSING = [(m, field.name) for m, field in FIELDS if field.default is dataclasses.MISSING]


def read(data: bytes) -> Request | Reply | None:
    """Return the message of bytes, whoever sends its kind."""
    if msgpack.unpackb(data)["kind"] in REQUESTS:
        return request_from_bytes(data)
    return reply_from_bytes(data)


def test_samples_are_all_messages() -> None:
    assert {type(sample) for sample in SAMPLE_REQUESTS} == set(REQUESTS.values())
    assert {type(sample) for sample in SAMPLE_REPLIES} == set(REPLIES.values())


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.KIND)
def test_message_when_packed_and_read_is_itself(message: Request | Reply) -> None:
    assert read(bytes_from_message(message)) == message


@pytest.mark.parametrize(("message", "name"), OPTIONAL_FIELDS, ids=lambda x: getattr(x, "KIND", x))
def test_field_when_it_came_later_and_is_missing_is_none(
    message: Request | Reply, name: str
) -> None:
    fields = msgpack.unpackb(bytes_from_message(message))
    del fields[name]
    assert getattr(read(msgpack.packb(fields)), name) is None


@pytest.mark.parametrize(("message", "name"), MISSING, ids=lambda x: getattr(x, "KIND", x))
def test_field_when_missing_is_refused_with_its_name(message: Request | Reply, name: str) -> None:
    fields = msgpack.unpackb(bytes_from_message(message))
    del fields[name]
    with pytest.raises(RemoteProtocolError, match=f"'{name}'"):
        read(msgpack.packb(fields))


def test_request_when_its_kind_is_unknown_names_those_that_are_known() -> None:
    with pytest.raises(RemoteProtocolError, match=r"'fly'.*ask_frame"):
        request_from_bytes(msgpack.packb({"kind": "fly"}))


def test_answer_when_its_kind_is_unknown_is_nothing() -> None:
    assert reply_from_bytes(msgpack.packb({"kind": "news"})) is None


def test_answer_when_of_another_version_says_what_to_do() -> None:
    with pytest.raises(RemoteProtocolError, match=f"version 2 .* this client {SCHEMA_VERSION}"):
        reply_from_bytes(msgpack.packb({"kind": "frame", "version": 2}))


def test_message_when_too_long_is_refused() -> None:
    with pytest.raises(RemoteProtocolError, match="at most"):
        request_from_bytes(bytes(MAX_REQUEST_BYTES + 1))
    with pytest.raises(RemoteProtocolError, match="at most"):
        reply_from_bytes(bytes(MAX_REPLY_BYTES + 1))


def test_header_when_not_finite_is_not_sent() -> None:
    header = dataclasses.replace(SAMPLE_REPLIES[0], age_s=float("nan"))  # type: ignore[type-var, call-arg] # the first is the header
    with pytest.raises(LocalProtocolError, match="age_s"):
        bytes_from_message(header)
