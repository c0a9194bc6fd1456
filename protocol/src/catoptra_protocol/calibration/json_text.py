"""JSON of calibration files: objects without duplicate names and without NaN."""

from __future__ import annotations

from typing import Any

from catoptra_protocol.errors import ConfigError, RemoteProtocolError, SourceLocation
from catoptra_protocol.json_object import json_object_from_text

MAX_BYTES = 2**20
"""Largest calibration file that is read: published ones have some kilobytes."""


def parse_json(text: str, file: str) -> dict[str, Any]:
    """The object of a file.

    Raises:
        ConfigError: No JSON object, NaN, a name twice, or nested too deeply.
    """
    try:
        return json_object_from_text(text, MAX_BYTES)
    except RemoteProtocolError as error:
        raise ConfigError(
            SourceLocation(file), key="JSON", value="", expected=f"an object: {error}"
        ) from error
