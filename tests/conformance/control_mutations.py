"""Mutations of a control server's behaviour, played live: commands that it ignores or misreads.

Those of the lines that it sends are generated: control_field_mutations.py.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from conformance.mutation import ConnectionMutation, MutateBytes, Mutation

Replacement = str | Callable[[re.Match[str]], str]


def _substitute(pattern: str, replacement: Replacement) -> MutateBytes:
    return lambda data: re.sub(pattern, replacement, data.decode("latin-1")).encode("latin-1")


def _misread(name: str, pattern: str, replacement: Replacement, noticed_by: str) -> Mutation:
    """Mutation of the client's lines."""
    change = _substitute(pattern, replacement)
    return Mutation(name, "control", lambda: ConnectionMutation(change), (noticed_by,))


def _slow_down(side: re.Match[str]) -> str:
    return f"{{{side[1]} {float(side[2]) / math.degrees(1.0):.4f}}}"


CONTROL_MUTATIONS: tuple[Mutation, ...] = (
    _misread("lower case not understood", r"(?s)^\s*[a-z].*", "", "spelling"),
    _misread("INIT without Name dropped", r"(?s)^INIT(?!.*\{Name ).*", "", "spawn"),
    _misread("Rotation of INIT ignored", r"\{Rotation [^}]*\}", "", "spawn_pose"),
    _misread(
        "Location of INIT ignored",
        r"\{Location [^}]*\}(?=.*Rotation)",
        "{Location 0,0,0}",
        "spawn_pose",
    ),
    _misread("no DRIVE", r"(?s)^DRIVE.*", "", "drive"),
    _misread("DRIVE 57 times slower", r"\{(Left|Right) ([\d.-]+)\}", _slow_down, "drive"),
    _misread("Left and Right swapped", r"\{Left (.*?)\} \{Right ", r"{Right \1} {Left ", "tour"),
    _misread("Normalized ignored", r"\{Normalized [^}]*\}", "", "tour"),
    _misread("standing ignored", r"(?s)^DRIVE \{Left 0\} \{Right 0\}.*", "", "tour"),
    Mutation(
        "RES always OK",
        "control",
        lambda: ConnectionMutation(mutate_reply=_substitute("Status Failed", "Status OK")),
        ("set_unknown",),
    ),
)
