"""Bytes of msgpack maps from dataclasses and back: the only module that imports msgpack.

Sizes are limited before memory is allocated; no extension types, no object hooks. `field_maps`
checks the maps against dataclasses. Source: spec.md of msgpack.
"""

from __future__ import annotations

from typing import Any

import msgpack

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.stream.field_maps import (
    FieldMap,
    field_error,
    fields_from_message,
    plain_value,
)

# The longest request publishes a note of 8 KiB, whose quotes and backslashes take two bytes each in
# JSON; the others hold a few numbers and names of at most 256 characters.
MAX_REQUEST_BYTES = 16 * 1024
# The largest reply lists landmarks: a thousand of 300 bytes each fit.
MAX_REPLY_BYTES = 512 * 1024
# Entries of a list, fields of a map: as many as the landmarks above, and the widest header twice.
_MAX_ITEMS = 2048
_MAX_FIELDS = 128
_MAX_QUOTED_CHARS = 80  # of a reason in an error text


def pack(kind: str, message: Any) -> bytes:
    """Encode a dataclass as a msgpack map, its kind first.

    Raises:
        LocalProtocolError: A number of the message is not finite.
    """
    data: bytes = msgpack.packb(fields_from_message(kind, message), default=plain_value)
    return data


def unpack(data: bytes, max_bytes: int) -> FieldMap:
    """Decode the msgpack map of a message, its values unchecked.

    Raises:
        RemoteProtocolError: The bytes are too many, or not exactly one map.
    """
    if len(data) > max_bytes:
        raise RemoteProtocolError(f"a message of {len(data)} bytes: at most {max_bytes} are read")
    # Limits for each container: msgpack allocates an array from its announced length alone.
    try:
        fields = msgpack.unpackb(
            data,
            max_str_len=max_bytes,
            max_bin_len=0,
            max_ext_len=0,
            max_array_len=_MAX_ITEMS,
            max_map_len=_MAX_FIELDS,
        )
    except (ValueError, msgpack.UnpackException) as error:
        # Some of msgpack's exceptions have no text, the nesting limit among them.
        reason = str(error) or type(error).__name__
        raise RemoteProtocolError(
            f"no msgpack that is accepted here: {reason[:_MAX_QUOTED_CHARS]}"
        ) from error
    if not isinstance(fields, dict):
        raise field_error("the message", fields, "a map of field names")
    return fields
