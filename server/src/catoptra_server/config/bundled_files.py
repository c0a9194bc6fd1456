"""Configurations bundled with the server, found by name: `p2at_omni` is robots/p2at_omni.ini."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.config.unknown_names import suggest_name

# In the repository a link to configs/, so that one copy exists; in a wheel a folder of real files.
BUNDLED_FOLDER = Path(__file__).parents[1] / "configs"

# Files of a folder share their suffix: none.glb (0.71) is no misspelt ok.glb.
_MIN_SIMILARITY = 0.8

FileKind = Literal["robots", "worlds", "landmarks", "cameras", "datasets"]
_SUFFIXES = {
    "robots": ".ini",
    "worlds": ".ini",
    "landmarks": ".csv",
    "cameras": ".ini",
    "datasets": ".ini",
}


def bundled_files(kind: FileKind) -> tuple[Path, ...]:
    """Bundled files of a kind, sorted by name."""
    return tuple(sorted((BUNDLED_FOLDER / kind).glob(f"*{_SUFFIXES[kind]}")))


def find_bundled_file(kind: FileKind, name: str) -> Path | None:
    """Bundled file of a bare name; None for the text of a path, or where there is none."""
    path = BUNDLED_FOLDER / kind / f"{name}{_SUFFIXES[kind]}"
    return path if len(Path(name).parts) == 1 and path.is_file() else None


def describe_missing_file(path: Path, kind: FileKind | None) -> str:
    """What was expected in place of a path that is no file, and what was probably meant.

    Args:
        path: the path.
        kind: kind of bundled files whose bare names would have done, too.
    """
    bundled = [file.stem for file in bundled_files(kind)] if kind else []
    or_name = f", or one of the bundled {kind}: {', '.join(bundled)}" if kind else ""
    problem = f"{path} is a folder" if path.is_dir() else f"there is no {path}"
    suggestion = suggest_name(path.name, [*bundled, *_list_files(path.parent)], _MIN_SIMILARITY)
    hint = f"; did you mean {suggestion}?" if suggestion else ""
    return f"a file that exists{or_name}; {problem}{hint}"


def _list_files(folder: Path) -> list[str]:
    """Names of the files in a folder; none for a folder that cannot be read."""
    try:
        return sorted(entry.name for entry in folder.iterdir() if entry.is_file())
    except OSError:
        return []


def find_configuration(kind: FileKind, path_or_name: str) -> Path:
    """Path of the configuration that a command line names.

    Args:
        kind: folder of the bundled files to search.
        path_or_name: a path, or the bare name of a bundled file.

    Returns:
        The path, which need not exist: `read_sections` reports a missing file with its reason.

    Raises:
        ConfigError: if a bare name is neither a file nor bundled; the message lists the names.
    """
    path = Path(path_or_name)
    # An existing file wins over a bundled name: a user's own `corridor` is never passed over.
    if path.exists() or path.suffix or len(path.parts) > 1:
        return path
    bundled = {file.stem: file for file in bundled_files(kind)}
    if path_or_name not in bundled:
        names = ", ".join(bundled)
        suggestion = suggest_name(path_or_name, bundled)
        hint = f"; did you mean {suggestion}?" if suggestion else ""
        raise ConfigError(
            SourceLocation(path_or_name),
            key="file",
            value=path_or_name,
            expected=f"an ini file, or one of the bundled {kind}: {names}{hint}",
        )
    return bundled[path_or_name]
