"""Messages of the stream as JSON text, for the page in a browser: the same maps as in msgpack.

A frame's image follows outside the text, as on the stream.
"""

from __future__ import annotations

from catoptra_protocol.json_object import json_object_from_text, text_from_json_object
from catoptra_protocol.stream.field_maps import fields_from_message, plain_value
from catoptra_protocol.stream.messages import reply_from_fields, request_from_fields
from catoptra_protocol.stream.msgpack_codec import MAX_REPLY_BYTES, MAX_REQUEST_BYTES
from catoptra_protocol.stream.replies import Reply
from catoptra_protocol.stream.requests import Request


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
    return request_from_fields(json_object_from_text(text, MAX_REQUEST_BYTES))


def reply_from_json(text: str) -> Reply | None:
    """Decode a message of a server; None for an unknown kind, which a newer server may send.

    Raises:
        RemoteProtocolError: The text is no reply, or one of another protocol version; names the
            missing or wrong field.
    """
    return reply_from_fields(json_object_from_text(text, MAX_REPLY_BYTES))
