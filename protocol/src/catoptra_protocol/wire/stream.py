"""The modern stream's messages as bytes: one msgpack map each, `kind` first. SPEC.md, last part."""

from __future__ import annotations

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.wire.envelope import (
    MAX_ANSWER_BYTES,
    MAX_REQUEST_BYTES,
    packed,
    read,
    read_text,
    unpacked,
)
from catoptra_protocol.wire.stream_answers import ANSWERS, Answer
from catoptra_protocol.wire.stream_requests import REQUESTS, Request

# Raised when a field changes its meaning or a new one becomes necessary; new fields alone do not.
SCHEMA_VERSION = 1


def bytes_from_message(message: Request | Answer) -> bytes:
    """Return a message's part. Raises LocalProtocolError for a number that is not finite."""
    return packed(message.KIND, message)


def request_from_bytes(data: bytes) -> Request:
    """Return what a client asks. Raises RemoteProtocolError naming what is missing or wrong."""
    fields = unpacked(data, MAX_REQUEST_BYTES)
    kind = read_text(fields, "kind")
    if kind not in REQUESTS:
        known = ", ".join(REQUESTS)
        raise RemoteProtocolError(f"kind: {kind[:80]!r}: expected one of {known}")
    return read(REQUESTS[kind], fields)


def answer_from_bytes(data: bytes) -> Answer | None:
    """Return what a server says; None for a kind that a newer server may have.

    Raises RemoteProtocolError naming what is missing or wrong, or another version.
    """
    fields = unpacked(data, MAX_ANSWER_BYTES)
    version = fields.get("version", SCHEMA_VERSION)
    if version != SCHEMA_VERSION:
        raise RemoteProtocolError(
            f"the server speaks version {version!r} of the stream, this client {SCHEMA_VERSION}: "
            "install the same release on both sides"
        )
    kind = read_text(fields, "kind")
    return read(ANSWERS[kind], fields) if kind in ANSWERS else None
