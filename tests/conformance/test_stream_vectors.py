"""The vectors of the stream: one message each; the error of a malformed one names its field."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.stream.messages import (
    bytes_from_message,
    reply_from_bytes,
    request_from_bytes,
)
from catoptra_protocol.stream.replies import REPLIES, Reply
from catoptra_protocol.stream.requests import REQUESTS, Request

VECTORS = sorted((Path(__file__).parent / "data/stream").glob("*.bytes"))


def decode(data: bytes, sender: str) -> Request | Reply | None:
    """Decode a message of a `client` or of a `server`."""
    return request_from_bytes(data) if sender == "client" else reply_from_bytes(data)


@pytest.mark.parametrize("path", VECTORS, ids=lambda path: path.stem)
def test_message_when_decoded_has_its_meaning(path: Path) -> None:
    vector = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    assert set(vector) <= {"description", "meaning", "error", "sender"}
    if "error" in vector:
        with pytest.raises(RemoteProtocolError, match=vector["error"]):
            decode(path.read_bytes(), vector["sender"])
    else:
        message = decode(path.read_bytes(), vector["sender"])
        assert message_to_json(message) == vector["meaning"]


def message_to_json(message: Request | Reply | None) -> object:
    """Message with the types of JSON."""
    if message is None:
        return None
    fields = {"kind": message.KIND, **dataclasses.asdict(message)}
    return json.loads(json.dumps(fields, default=lambda member: member.value))


def test_vectors_when_listed_have_one_of_every_kind() -> None:
    meanings = (json.loads(path.with_suffix(".json").read_text())["meaning"] for path in VECTORS)
    assert {meaning["kind"] for meaning in meanings if meaning} == {*REQUESTS, *REPLIES}


def test_frame_when_encoded_has_the_bytes_of_the_vector() -> None:
    data = next(path for path in VECTORS if path.stem == "frame").read_bytes()
    message = reply_from_bytes(data)
    assert message is not None
    assert bytes_from_message(message) == data
