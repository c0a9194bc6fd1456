"""Messages of the stream as msgpack and as JSON, and their texts for logs."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import msgpack
import pytest

from catoptra_protocol.errors import InvalidRequestError, LocalProtocolError, RemoteProtocolError
from catoptra_protocol.limits import MAX_REQUEST_BYTES
from catoptra_protocol.stream.codec import MAX_REPLY_BYTES, FieldMap
from catoptra_protocol.stream.messages import (
    SCHEMA_VERSION,
    bytes_from_message,
    json_from_message,
    reply_from_bytes,
    reply_from_json,
    request_from_bytes,
    request_from_json,
)
from catoptra_protocol.stream.replies import (
    REPLIES,
    DifferenceRecord,
    EffectRecord,
    LandmarkRecord,
    NoteRecord,
    PlanAlternative,
    Reply,
    RobotState,
    StartPoseRecord,
    StateReply,
)
from catoptra_protocol.stream.requests import (
    REQUESTS,
    FrameVariant,
    GetFrameRequest,
    ImageEncoding,
    PublishRequest,
    Request,
    Transform,
)
from helpers.configs import REPOSITORY
from helpers.stream_messages import HEADER, ROBOT_STATE, SAMPLE_REPLIES, SAMPLE_REQUESTS

MESSAGES = [*SAMPLE_REQUESTS, *SAMPLE_REPLIES]
FIELDS = [(message, field) for message in MESSAGES for field in dataclasses.fields(message)]
OPTIONAL_FIELDS = [(m, f) for m, f in FIELDS if f.default is not dataclasses.MISSING]
MISSING = [(m, field.name) for m, field in FIELDS if field.default is dataclasses.MISSING]


def decode(data: bytes) -> Request | Reply | None:
    """Decode a message of either side."""
    if msgpack.unpackb(data)["kind"] in REQUESTS:
        return request_from_bytes(data)
    return reply_from_bytes(data)


def test_samples_are_all_messages() -> None:
    assert {type(sample) for sample in SAMPLE_REQUESTS} == set(REQUESTS.values())
    assert {type(sample) for sample in SAMPLE_REPLIES} == set(REPLIES.values())


class Form(NamedTuple):
    """A form of messages on the wire: of whole messages, and of their fields."""

    encode: Callable[[Request | Reply], Any]
    pack: Callable[[object], Any]
    read_request: Callable[[Any], Request]
    read_reply: Callable[[Any], Reply | None]
    blank: bytes | str


FORMS = [
    Form(bytes_from_message, msgpack.packb, request_from_bytes, reply_from_bytes, b"\0"),
    Form(json_from_message, json.dumps, request_from_json, reply_from_json, " "),
]
both_forms = pytest.mark.parametrize("form", FORMS, ids=["msgpack", "json"])


@both_forms
@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: m.KIND)
def test_message_when_encoded_and_decoded_is_equal(message: Request | Reply, form: Form) -> None:
    read = form.read_request if message.KIND in REQUESTS else form.read_reply
    assert read(form.encode(message)) == message


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


@both_forms
def test_request_when_its_kind_is_unknown_lists_the_known_kinds(form: Form) -> None:
    with pytest.raises(RemoteProtocolError, match=r"'fly'.*get_frame"):
        form.read_request(form.pack({"kind": "fly"}))


@both_forms
@pytest.mark.parametrize(
    "fields", [{"kind": "fly"}, {"kind": "step"}, {"kind": "step", "time_s": "1"}, {}, {"kind": 1}]
)
def test_request_when_another_field_is_wrong_is_rejected_with_its_id(
    fields: FieldMap, form: Form
) -> None:
    with pytest.raises(InvalidRequestError) as caught:
        form.read_request(form.pack({**fields, "id": 7}))
    assert caught.value.request_id == 7


@both_forms
@pytest.mark.parametrize("id_", [0, -1, 1.0, True, 2**63, None, "1", math.nan])
@pytest.mark.parametrize("kind", ["get_status", "fly"])
def test_request_when_its_id_is_no_int_above_0_is_rejected_without_an_id(
    kind: str, id_: object, form: Form
) -> None:
    with pytest.raises(RemoteProtocolError, match=r"id|kind|NaN") as caught:
        form.read_request(form.pack({"kind": kind, "id": id_}))
    assert not isinstance(caught.value, InvalidRequestError)


@both_forms
def test_reply_when_its_kind_is_unknown_is_none(form: Form) -> None:
    assert form.read_reply(form.pack({"kind": "forecast"})) is None


@both_forms
def test_reply_when_of_another_version_names_the_remedy(form: Form) -> None:
    expected = f"version 2 .* this client {SCHEMA_VERSION}: install the same release"
    with pytest.raises(RemoteProtocolError, match=expected):
        form.read_reply(form.pack({"kind": "frame", "version": 2}))


@both_forms
def test_message_when_too_long_is_rejected(form: Form) -> None:
    with pytest.raises(RemoteProtocolError, match="at most"):
        form.read_request(form.blank * (MAX_REQUEST_BYTES + 1))
    with pytest.raises(RemoteProtocolError, match="at most"):
        form.read_reply(form.blank * (MAX_REPLY_BYTES + 1))


def test_request_when_optional_fields_are_missing_has_their_defaults() -> None:
    text = '{"kind": "get_frame", "id": 1, "robot": "", "camera": "", "encoding": "jpeg"}'
    assert request_from_json(text) == GetFrameRequest(1, "", "", ImageEncoding.JPEG)


def test_message_when_encoded_begins_with_the_kind() -> None:
    assert next(iter(json.loads(json_from_message(HEADER)).items())) == ("kind", "frame")


@pytest.mark.parametrize("number", ["9" * 400, "1e400", "-1e999", "NaN", "Infinity", "9" * 5000])
def test_request_when_a_number_is_beyond_float64_is_rejected(number: str) -> None:
    text = '{"kind": "drive", "id": 7, "left": %s, "right": 0, "normalized": false}'
    with pytest.raises(RemoteProtocolError, match="no JSON"):
        request_from_json(text % number)


def test_request_when_it_holds_the_largest_note_fits() -> None:
    request = PublishRequest(1, "n" * 64, '{"text":"' + 8181 * "x" + '"}')
    assert len(request.text) == 8192
    assert request_from_json(json_from_message(request)) == request


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


def test_requests_are_listed_under_their_kinds_and_have_an_id() -> None:
    for kind, request in REQUESTS.items():
        assert kind == request.KIND == kind.lower()
        assert dataclasses.fields(request)[0].name == "id"


# Dataclasses inside messages; they have no kind of their own.
RECORDS = (
    *(Transform, LandmarkRecord, StartPoseRecord, EffectRecord, PlanAlternative),
    *(FrameVariant, DifferenceRecord, RobotState, NoteRecord),
)
SPECIFICATION = REPOSITORY / "protocol/SPEC.md"


def test_replies_are_listed_under_their_kinds() -> None:
    assert all(kind == reply.KIND for kind, reply in REPLIES.items())


def test_specification_names_every_kind_and_field() -> None:
    chapter = SPECIFICATION.read_text(encoding="utf-8").partition("## 9. The ZeroMQ stream")[2]
    for message_type in (*REQUESTS.values(), *REPLIES.values(), *RECORDS):
        names = [field.name for field in dataclasses.fields(message_type)]
        for name in [*names, getattr(message_type, "KIND", "id")]:
            assert f"`{name}`" in chapter, f"{message_type.__name__}: {name}"


def test_header_when_logged_names_camera_size_and_age() -> None:
    assert str(HEADER) == "frame 42 of 'Omni', 6 x 4 px raw, 30.0 ms old"
