"""Files of conversations, common to the players of both transports.

A file has a `description`, the `port` (control, image or stream), whether a server must pass
(`required`, default true), and its `steps`. `dialect` (ut2004, udk) and `image_mode` (legacy)
restrict the servers that the conversation applies to.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# Generous: a working server replies in milliseconds, on a busy machine in a second or two.
TIMEOUT_S = 5.0
_DOCUMENT_KEYS = {"description", "port", "required", "dialect", "image_mode", "needs", "steps"}

StepSpec = dict[str, Any]  # as JSON holds it
Address = tuple[str, int]


class StepFailedError(Exception):
    """The server did not fulfil a step."""


@dataclass(frozen=True, slots=True)
class Conversation:
    """One file."""

    name: str
    description: str
    port: str
    is_required: bool
    steps: tuple[StepSpec, ...]
    dialect: str | None = None
    """Dialect of the servers it applies to; None = any."""
    image_mode: str | None = None
    """`plain` or `legacy`; None = any, as for the control port and the stream."""
    needed_part: str | None = None
    """Type of a part that the robot must have, as in GETCONF; `needs` in the file."""

    def applies_to(self, dialect: str, image_mode: str) -> bool:
        """Whether the conversation is for a server with this dialect and image mode."""
        return self.dialect in (None, dialect) and self.image_mode in (None, image_mode)


def read_conversation(path: Path, step_keys: dict[str, Iterable[str]]) -> Conversation:
    """Read the conversation of a file.

    Args:
        path: JSON file.
        step_keys: Keys that steps may have, by port.

    Raises:
        ValueError: A key is unknown.
    """
    document = json.loads(path.read_text(encoding="utf-8"))
    port, steps = document["port"], tuple(document["steps"])
    unknown = {key for step in steps for key in step} - set(step_keys[port])
    if unknown or set(document) - _DOCUMENT_KEYS:
        raise ValueError(f"{path}: unknown keys {sorted(unknown) or sorted(document)}")
    return Conversation(
        path.stem,
        document["description"],
        port,
        document.get("required", True),
        steps,
        document.get("dialect"),
        document.get("image_mode", "plain" if port == "image" else None),
        document.get("needs"),
    )
