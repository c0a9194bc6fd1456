"""Configurations that come with the server: `p2at_omni` means its own robots/p2at_omni.ini.

The folder is the repository's configs/, which every distribution carries a copy of.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from catoptra_protocol.errors import ConfigError, Where

SHIPPED = Path(__file__).parents[1] / "configs"

Kind = Literal["robots", "worlds"]


def shipped_files(kind: Kind) -> tuple[Path, ...]:
    """Return the ini files of a kind that come with the server, by name."""
    return tuple(sorted((SHIPPED / kind).glob("*.ini")))


def configuration_file(kind: Kind, text: str) -> Path:
    """Return the file that a command line means: a path, or the bare name of a shipped one.

    A path need not exist: who reads it complains. Raises ConfigError for a name that is not there.
    """
    path = Path(text)
    if path.exists() or path.suffix or len(path.parts) > 1:
        return path
    shipped = {file.stem: file for file in shipped_files(kind)}
    if text not in shipped:
        known = ", ".join(shipped)
        raise ConfigError(
            Where(text),
            key="file",
            value=text,
            expected=f"an ini file, or one of the {kind} that come with the server: {known}",
        )
    return shipped[text]
