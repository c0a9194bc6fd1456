"""Configurations that come with the server: `p2at_omni` means its own robots/p2at_omni.ini.

The folder is the repository's configs/, which every distribution carries a copy of.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from catoptra_protocol.errors import ConfigError, SourceLocation

BUNDLED_FOLDER = Path(__file__).parents[1] / "configs"

FileKind = Literal["robots", "worlds"]


def bundled_files(kind: FileKind) -> tuple[Path, ...]:
    """Return the ini files of a kind that come with the server, by name."""
    return tuple(sorted((BUNDLED_FOLDER / kind).glob("*.ini")))


def find_configuration(kind: FileKind, path_or_name: str) -> Path:
    """Return the file that a command line means: a path, or the bare name of a shipped one.

    A path need not exist: who reads it complains. Raises ConfigError for a name that is not there.
    """
    path = Path(path_or_name)
    if path.exists() or path.suffix or len(path.parts) > 1:
        return path
    shipped = {file.stem: file for file in bundled_files(kind)}
    if path_or_name not in shipped:
        known = ", ".join(shipped)
        raise ConfigError(
            SourceLocation(path_or_name),
            key="file",
            value=path_or_name,
            expected=f"an ini file, or one of the {kind} that come with the server: {known}",
        )
    return shipped[path_or_name]
