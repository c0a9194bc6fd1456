"""Notes about a robot: JSON objects under a name, such as the belief of a localizer (SPEC.md 9.7).

Server and viewers give no meaning to a note: the server only checks that it is one.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.json_object import json_object_from_text, text_from_json_object
from catoptra_protocol.limits import MAX_NOTE_BYTES, MAX_NOTE_NAME_CHARS, MAX_NOTES


def check_note(name: str, text: str) -> None:
    """Raise unless a server accepts a note.

    Args:
        name: Name of the note.
        text: A JSON object.

    Raises:
        LocalProtocolError: The reason against the note, short and without control characters.
    """
    # The length first: a giant name would be quoted.
    if not 0 < len(name) <= MAX_NOTE_NAME_CHARS:
        raise LocalProtocolError(
            f"a note's name of {len(name)} characters: expected 1 to {MAX_NOTE_NAME_CHARS}"
        )
    # Surrogates are not printable either.
    if not name.isprintable():
        raise LocalProtocolError(f"a note's name {name!a}: expected printable characters only")
    try:
        json_object_from_text(text, MAX_NOTE_BYTES)
    except RemoteProtocolError as error:
        raise LocalProtocolError(f"note {name!r}: {error}") from error


def check_note_count(names: Mapping[str, Any], name: str) -> None:
    """Raise if a robot with notes of these names cannot have one more.

    Raises:
        LocalProtocolError: The robot has as many notes as it may, of other names.
    """
    if name not in names and len(names) >= MAX_NOTES:
        raise LocalProtocolError(
            f"note {name!r}: the robot has notes of {MAX_NOTES} names, the limit: use one of them"
        )


def text_from_note(name: str, note: Mapping[str, Any]) -> str:
    """Text of a note; numbers and arrays of NumPy become numbers and lists.

    Raises:
        LocalProtocolError: The name or the note is none that a server accepts.
    """
    try:
        text = text_from_json_object(note, default=_plain_value)
    except LocalProtocolError as error:
        raise LocalProtocolError(f"note {name!r}: {error}") from error
    check_note(name, text)
    return text


def _plain_value(value: Any) -> Any:
    # By the method, which arrays and scalars of NumPy have: this module imports without NumPy.
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is no value of JSON")
