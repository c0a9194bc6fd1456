"""Notes about a robot: JSON objects under a name, such as the belief of a localizer (SPEC.md 9.7).

Server and viewers give no meaning to a note: the server only checks that it is one.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.json_object import json_object_from_text, text_from_json_object
from catoptra_protocol.limits import MAX_NOTE_BYTES, MAX_NOTE_NAME_CHARS, MAX_NOTES


def find_note_error(name: str, text: str) -> str:
    """Reason against a note; empty if there is none.

    Args:
        name: Name of the note.
        text: A JSON object.
    """
    # The length first: a giant name would be quoted.
    if not 0 < len(name) <= MAX_NOTE_NAME_CHARS:
        return f"a note's name of {len(name)} characters: expected 1 to {MAX_NOTE_NAME_CHARS}"
    # Surrogates are not printable either.
    if not name.isprintable():
        return f"a note's name {name!a}: expected printable characters only"
    try:
        json_object_from_text(text, MAX_NOTE_BYTES)
    except RemoteProtocolError as error:
        return f"note {name!r}: {error}"
    return ""


def find_note_count_error(names: Mapping[str, Any], name: str) -> str:
    """Reason against one more note beside those of a robot; empty if there is none."""
    if name in names or len(names) < MAX_NOTES:
        return ""
    return f"note {name!r}: the robot has notes of {MAX_NOTES} names, the limit: use one of them"


def text_from_note(name: str, note: Mapping[str, Any]) -> str:
    """Text of a note; numbers and arrays of NumPy become numbers and lists.

    Raises:
        LocalProtocolError: The name or the note is none that a server accepts.
    """
    try:
        text = text_from_json_object(note, default=_plain_value)
    except LocalProtocolError as error:
        raise LocalProtocolError(f"note {name!r}: {error}") from error
    reason = find_note_error(name, text)
    if reason:
        raise LocalProtocolError(reason)
    return text


def _plain_value(value: Any) -> Any:
    # By the method, which arrays and scalars of NumPy have: this module imports without NumPy.
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is no value of JSON")
