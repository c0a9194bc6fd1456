"""Names that a file or a user may have meant: keys and sections that nothing reads, bundled files.

A misspelt name is the commonest mistake in a configuration, and a silent default the hardest to
find. In sections of this program (`[Catoptra.*]`) an unknown name is an error. Sections of USARSim
and of its engine carry keys that have no meaning here: an unknown one is a warning, or an error if
the user wants to be strict.

Configurations ship by link: `configs` beside this package is a link to the repository's folder, so
that one copy exists, and a folder of real files in a wheel. `p2at_omni` is robots/p2at_omni.ini.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.names import list_names, suggest_name
from catoptra_protocol.slotted_dataclass import dataclass

log = logging.getLogger(__name__)
_BUNDLED_FOLDER = Path(__file__).parents[1] / "configs"
_OWN_PACKAGE = "catoptra"
FileKind = Literal["robots", "worlds", "landmarks", "cameras", "datasets"]
_SUFFIXES = {
    "robots": ".ini",
    "worlds": ".ini",
    "landmarks": ".csv",
    "cameras": ".ini",
    "datasets": ".ini",
}
# Files of a folder share their suffix: none.glb (0.71) is no misspelt ok.glb.
_MIN_FILE_SIMILARITY = 0.8


@dataclass(frozen=True, slots=True)
class UnknownName:
    """A key, or a section, that no reader has read."""

    key: str
    """The key; empty for a section."""
    value: str
    where: SourceLocation
    section: str
    """Name of the section, also for a key of a struct in the section."""
    suggestion: str = ""
    """Known name that is most similar; empty for none."""

    @property
    def is_error(self) -> bool:
        """Whether the server rejects the file."""
        # A section of ours that nothing uses may be a spare, such as another mirror's.
        return is_own_section(self.section) and bool(self.key or self.suggestion)

    def describe(self) -> str:
        """The problem without the location."""
        what = f"key {self.key} is unknown" if self.key else f"nothing uses [{self.section}]"
        hint = f"; did you mean {self.suggestion}?" if self.suggestion else ""
        return f"{what} and has no effect{hint}" if self.key else f"{what}{hint}"

    def make_error(self) -> ConfigError:
        """Error with file, line, key and value."""
        known = self.suggestion or "configs/README.md lists them"
        if not self.key:
            return ConfigError(
                self.where, key="section", value=self.section, expected=f"a section in use: {known}"
            )
        question = f"did you mean {known}?" if self.suggestion else known
        return ConfigError(
            self.where,
            key=f"{self.section}.{self.key}",
            value=self.value,
            expected=f"a known key; {question}",
        )


def report_unknown_names(names: Iterable[UnknownName], *, is_strict: bool = False) -> None:
    """Log unknown names of USARSim's sections, and raise an error for one in our own.

    Args:
        names: Unknown names of a file that was read.
        is_strict: Raise for names of all sections.

    Raises:
        ConfigError: For the first name that is an error.
    """
    for name in names:
        if name.is_error or is_strict:
            raise name.make_error()
        log.warning("%s: %s", name.where, name.describe())


def is_own_section(name: str) -> bool:
    """Whether a section is one of this program, not of USARSim."""
    return name.partition(".")[0].lower() == _OWN_PACKAGE


def find_configuration(kind: FileKind, path_or_name: str) -> Path:
    """Path of the configuration that a command line names.

    Args:
        kind: folder of the bundled files to search.
        path_or_name: a path, or the bare name of a bundled file.

    Returns:
        The path, which need not exist: `read_sections` reports a missing file with the reason.

    Raises:
        ConfigError: if a bare name is neither a file nor bundled; the message lists the names.
    """
    path = Path(path_or_name)
    # An existing file wins over a bundled name: a user's own `corridor` is never passed over.
    # By os.path: no error for a name longer than the system's names.
    if os.path.exists(path) or path.suffix or len(path.parts) > 1:
        return path
    bundled = {file.stem: file for file in bundled_files(kind)}
    if path_or_name not in bundled:
        raise ConfigError(
            SourceLocation(path_or_name),
            key="file",
            value=path_or_name,
            expected=f"an ini file, or one of the bundled {kind}: "
            + list_names(path_or_name, bundled),
        )
    return bundled[path_or_name]


def bundled_files(kind: FileKind) -> tuple[Path, ...]:
    """Bundled files of a kind, sorted by name."""
    return tuple(sorted((_BUNDLED_FOLDER / kind).glob(f"*{_SUFFIXES[kind]}")))


def find_bundled_file(kind: FileKind, name: str) -> Path | None:
    """Bundled file of a bare name; None for the text of a path, or where there is none.

    A robot is based on a camera, too, by that camera's name.
    """
    if len(Path(name).parts) != 1:
        return None
    kinds: tuple[FileKind, ...] = ("robots", "cameras") if kind == "robots" else (kind,)
    paths = (_BUNDLED_FOLDER / one / f"{name}{_SUFFIXES[one]}" for one in kinds)
    return next(filter(os.path.isfile, paths), None)


def describe_missing_file(path: Path, kind: FileKind | None) -> str:
    """What was expected in place of a path that is no file, and what was probably meant.

    Args:
        path: the path.
        kind: kind of bundled files whose bare names would have done, too.
    """
    bundled = [file.stem for file in bundled_files(kind)] if kind else []
    or_name = f", or one of the bundled {kind}: {', '.join(bundled)}" if kind else ""
    problem = f"{path} is a folder" if os.path.isdir(path) else f"there is no {path}"
    suggestion = suggest_name(
        path.name, [*bundled, *_list_files(path.parent)], _MIN_FILE_SIMILARITY
    )
    hint = f"; did you mean {suggestion}?" if suggestion else ""
    return f"a file that exists{or_name}; {problem}{hint}"


def _list_files(folder: Path) -> list[str]:
    """Names of the files in a folder; none for a folder that cannot be read."""
    try:
        return sorted(entry.name for entry in folder.iterdir() if entry.is_file())
    except (OSError, ValueError):  # ValueError: a name with a NUL
        return []
