"""The modern stream's messages as bytes: one msgpack map each, `kind` first. SPEC.md, last part."""

from __future__ import annotations

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.stream.msgpack_codec import (
    MAX_REPLY_BYTES,
    MAX_REQUEST_BYTES,
    dataclass_from_fields,
    pack,
    read_str_field,
    unpack,
)
from catoptra_protocol.stream.replies import REPLIES, Reply
from catoptra_protocol.stream.requests import REQUESTS, Request

# Raised when a field changes its meaning or a new one becomes necessary; new fields alone do not.
SCHEMA_VERSION = 1


def bytes_from_message(message: Request | Reply) -> bytes:
    """Return a message's part. Raises LocalProtocolError for a number that is not finite."""
    return pack(message.KIND, message)


def request_from_bytes(data: bytes) -> Request:
    """Return what a client asks. Raises RemoteProtocolError naming what is missing or wrong."""
    fields = unpack(data, MAX_REQUEST_BYTES)
    kind = read_str_field(fields, "kind")
    if kind not in REQUESTS:
        known = ", ".join(REQUESTS)
        raise RemoteProtocolError(f"kind: {kind[:80]!r}: expected one of {known}")
    return dataclass_from_fields(REQUESTS[kind], fields)


def reply_from_bytes(data: bytes) -> Reply | None:
    """Return what a server says; None for a kind that a newer server may have.

    Raises RemoteProtocolError naming what is missing or wrong, or another version.
    """
    fields = unpack(data, MAX_REPLY_BYTES)
    version = fields.get("version", SCHEMA_VERSION)
    if version != SCHEMA_VERSION:
        raise RemoteProtocolError(
            f"the server speaks version {version!r} of the stream, this client {SCHEMA_VERSION}: "
            "install the same release on both sides"
        )
    kind = read_str_field(fields, "kind")
    return dataclass_from_fields(REPLIES[kind], fields) if kind in REPLIES else None
