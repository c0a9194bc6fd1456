"""JSON objects of peers: text whose size, depth and numbers are limited.

Stricter than RFC 8259 where readers differ (section 4, 6 and 8.2 there): no duplicate names, no
numbers beyond float64, no NaN and Infinity, which Python accepts, and no unpaired surrogates, which
UTF-8 cannot encode.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError

# Objects and lists inside each other: the deepest message has six.
MAX_JSON_DEPTH = 16
_MAX_INT_CHARS = 20  # of 63 bits, with a sign
_MAX_QUOTED_CHARS = 80  # of a reason in an error text


def json_object_from_text(text: str, max_bytes: int) -> dict[str, Any]:
    """Decode a JSON object.

    Args:
        text: The text of one JSON object.
        max_bytes: Largest accepted size of the text in UTF-8.

    Raises:
        RemoteProtocolError: The text is longer, no JSON, no object, nested beyond MAX_JSON_DEPTH,
            or has a name twice, a number that is not finite or an unpaired surrogate.
    """
    # No text has fewer bytes than characters: a giant one is rejected without a copy. Unpaired
    # surrogates are rejected below.
    num_bytes = len(text) if len(text) > max_bytes else len(text.encode(errors="replace"))
    if num_bytes > max_bytes:
        raise RemoteProtocolError(f"JSON of {num_bytes} bytes: at most {max_bytes} are read")
    try:
        value = json.loads(
            text,
            object_pairs_hook=_dict_from_pairs,
            parse_int=_parse_int,
            parse_float=_parse_float,
            parse_constant=_reject_constant,
        )
    except RecursionError as error:
        raise _depth_error() from error
    except ValueError as error:  # JSONDecodeError, or an int of too many digits
        raise RemoteProtocolError(f"no JSON: {str(error)[:_MAX_QUOTED_CHARS]}") from error
    if not isinstance(value, dict):
        raise RemoteProtocolError(
            f"JSON that is {repr(value)[:_MAX_QUOTED_CHARS]}: expected an object"
        )
    _check_depth(value)
    _check_surrogates(text, value)
    return value


def text_from_json_object(fields: Mapping[str, Any], *, default: Any = None) -> str:
    """Encode a JSON object without spaces, in ASCII.

    Args:
        fields: Values of JSON by name; tuples become lists.
        default: Function that converts other values to these, as in json.dumps.

    Raises:
        LocalProtocolError: A number is not finite, or a value is none of JSON.
    """
    try:
        return json.dumps(fields, default=default, allow_nan=False, separators=(",", ":"))
    except (ValueError, TypeError, RecursionError) as error:
        raise LocalProtocolError(f"no JSON object: {error}") from error


def _dict_from_pairs(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    fields = dict(pairs)
    if len(fields) < len(pairs):
        raise ValueError("an object with one name twice")
    return fields


def _reject_constant(name: str) -> float:
    raise ValueError(f"{name}: expected a finite number")


def _parse_int(text: str) -> int:
    # Longer ones have no float, and their conversion takes the square of their length.
    if len(text) > _MAX_INT_CHARS:
        raise ValueError(f"an int of {len(text)} characters: at most {_MAX_INT_CHARS}")
    return int(text)


def _parse_float(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError("a number beyond all of float64")
    return number


def _check_depth(root: dict[str, Any]) -> None:
    # Level by level: without recursion, so that no depth exhausts the stack.
    level: list[Any] = [root]
    for _ in range(MAX_JSON_DEPTH):
        level = [
            value
            for container in level
            for value in (container.values() if type(container) is dict else container)
            if type(value) is dict or type(value) is list
        ]
        if not level:
            return
    raise _depth_error()


def _check_surrogates(text: str, value: dict[str, Any]) -> None:
    """Check that UTF-8 can encode all names and texts of a value of limited depth."""
    # Without such an escape the text itself has them all.
    parts = [text, json.dumps(value, ensure_ascii=False)] if "\\ud" in text.lower() else [text]
    try:
        for part in parts:
            part.encode()
    except UnicodeEncodeError as error:
        raise RemoteProtocolError("no JSON: an unpaired surrogate") from error


def _depth_error() -> RemoteProtocolError:
    return RemoteProtocolError(f"JSON of more than {MAX_JSON_DEPTH} nested objects and lists")
