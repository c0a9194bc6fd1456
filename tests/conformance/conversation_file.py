"""What the two kinds of conversations have in common: their files, and how they go wrong.

A file says what it shows (`why`), the `port` (control, image or stream), whether a server must pass
(`required`, true if absent), and lists its `steps`. `dialect` (ut2004, udk) and `images` (legacy)
name the server that it is for, where it is not for all.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

TIMEOUT_S = 10.0  # of a server that works, however busy its machine is
_DOCUMENT_KEYS = {"why", "port", "required", "dialect", "images", "steps"}

StepSpec = dict[str, Any]  # as JSON holds it
Address = tuple[str, int]


class StepFailedError(Exception):
    """The server did not do what a step expects."""


@dataclass(frozen=True, slots=True)
class Conversation:
    """One file. dialect: None = any; images: None = any control or stream, `plain` or `legacy`."""

    name: str
    description: str
    port: str
    is_required: bool
    steps: tuple[StepSpec, ...]
    dialect: str | None = None
    image_mode: str | None = None

    def applies_to(self, dialect: str, image_mode: str) -> bool:
        """Return whether it is for a server that speaks this dialect and sends images so."""
        return self.dialect in (None, dialect) and self.image_mode in (None, image_mode)


def read_conversation(path: Path, step_keys: dict[str, Iterable[str]]) -> Conversation:
    """Return the conversation of a file. known: the keys that steps may have, by port."""
    document = json.loads(path.read_text(encoding="utf-8"))
    port, steps = document["port"], tuple(document["steps"])
    unknown = {key for step in steps for key in step} - set(step_keys[port])
    if unknown or set(document) - _DOCUMENT_KEYS:
        raise ValueError(f"{path}: unknown keys {sorted(unknown) or sorted(document)}")
    return Conversation(
        path.stem,
        document["why"],
        port,
        document.get("required", True),
        steps,
        document.get("dialect"),
        document.get("images", "plain" if port == "image" else None),
    )
