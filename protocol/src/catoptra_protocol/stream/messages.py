"""Messages of the stream as bytes: one msgpack map each, `kind` first (SPEC.md 9.1); and as JSON.

The page in a browser reads the same maps as JSON text, by the same readers. A frame's image follows
outside the map in both.
"""

from __future__ import annotations

from catoptra_protocol.errors import InvalidRequestError, RemoteProtocolError
from catoptra_protocol.json_object import json_object_from_text, text_from_json_object
from catoptra_protocol.limits import MAX_REQUEST_BYTES
from catoptra_protocol.stream.codec import (
    MAX_REPLY_BYTES,
    FieldMap,
    dataclass_from_fields,
    fields_from_message,
    pack,
    plain_value,
    read_int_field,
    read_str_field,
    unpack,
)
from catoptra_protocol.stream.replies import REPLIES, Reply
from catoptra_protocol.stream.requests import REQUESTS, Request

# Raised when a field changes its meaning or a new required field appears; optional fields do not
# raise it, since readers ignore unknown fields and fill in defaults.
SCHEMA_VERSION = 1


def bytes_from_message(message: Request | Reply) -> bytes:
    """Encode a message as one ZeroMQ part.

    Raises:
        LocalProtocolError: A number of the message is not finite.
    """
    return pack(message.KIND, message)


def plain_fields_from_message(message: Request | Reply) -> FieldMap:
    """Map of a message with all nested values converted, which encoders encode fast.

    Raises:
        LocalProtocolError: A number of the message is not finite.
    """
    return unpack(bytes_from_message(message), MAX_REPLY_BYTES)


def request_from_bytes(data: bytes) -> Request:
    """Decode a request of a client.

    Raises:
        InvalidRequestError: The id is readable; the kind or another field is wrong.
        RemoteProtocolError: The bytes are no request with an id above 0.
    """
    return _request_from_fields(unpack(data, MAX_REQUEST_BYTES))


def _request_from_fields(fields: FieldMap) -> Request:
    """Request of a client from a decoded map.

    Raises:
        InvalidRequestError: The id is readable; the kind or another field is wrong.
        RemoteProtocolError: The map is no request with an id above 0.
    """
    id_ = _readable_id(fields)
    try:
        request = _dataclass_of_request(fields)
    except RemoteProtocolError as error:
        # With the id the client relates the error to its request; 0 would fit any.
        raise (InvalidRequestError(str(error), id_) if id_ else error) from error
    if not id_:
        raise RemoteProtocolError(f"id: {request.id}: expected an int above 0")
    return request


def _readable_id(fields: FieldMap) -> int:
    """Id of a request; 0 if it is missing, wrong or below 1."""
    try:
        return max(0, read_int_field(fields, "id"))
    except RemoteProtocolError:
        return 0


def _dataclass_of_request(fields: FieldMap) -> Request:
    kind = read_str_field(fields, "kind")
    # An error, unlike an unknown reply: the client waits for the outcome of its request.
    if kind not in REQUESTS:
        known = ", ".join(REQUESTS)
        raise RemoteProtocolError(f"kind: {kind[:80]!r}: expected one of {known}")
    return dataclass_from_fields(REQUESTS[kind], fields)


def reply_from_bytes(data: bytes) -> Reply | None:
    """Decode a message of a server; None for an unknown kind, which a newer server may send.

    Raises:
        RemoteProtocolError: The bytes are no reply, or one of another protocol version; names the
            missing or wrong field.
    """
    return _reply_from_fields(unpack(data, MAX_REPLY_BYTES))


def _reply_from_fields(fields: FieldMap) -> Reply | None:
    """Message of a server from a decoded map; None for an unknown kind.

    Raises:
        RemoteProtocolError: The map is no reply, or one of another protocol version; names the
            missing or wrong field.
    """
    # Before the kind: a field of another version may have another meaning under the same name.
    version = fields.get("version", SCHEMA_VERSION)
    if version != SCHEMA_VERSION:
        raise RemoteProtocolError(
            f"the server has version {version!r} of the stream, this client {SCHEMA_VERSION}: "
            "install the same release on both sides"
        )
    kind = read_str_field(fields, "kind")
    return dataclass_from_fields(REPLIES[kind], fields) if kind in REPLIES else None


def json_from_message(message: Request | Reply) -> str:
    """Encode a message as a JSON object, its kind first.

    Raises:
        LocalProtocolError: A number of the message is not finite.
    """
    return text_from_json_object(fields_from_message(message.KIND, message), default=plain_value)


def request_from_json(text: str) -> Request:
    """Decode a request of a client.

    Raises:
        InvalidRequestError: The id is readable; the kind or another field is wrong.
        RemoteProtocolError: The text is no request with an id above 0.
    """
    return _request_from_fields(json_object_from_text(text, MAX_REQUEST_BYTES))


def reply_from_json(text: str) -> Reply | None:
    """Decode a message of a server; None for an unknown kind, which a newer server may send.

    Raises:
        RemoteProtocolError: The text is no reply, or one of another protocol version; names the
            missing or wrong field.
    """
    return _reply_from_fields(json_object_from_text(text, MAX_REPLY_BYTES))
