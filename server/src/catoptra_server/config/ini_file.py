"""An ini file merged with its base files: one reader for each section name.

Bases are read first, and each file overrides its bases line by line. What no reader
has read afterwards is an unknown name.
"""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.errors import SourceLocation
from catoptra_protocol.names import suggest_name
from catoptra_server.config.known_names import FileKind, UnknownName, is_own_section
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.unreal_ini import Section, parse_sections, read_sections
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES

# Robots of UDK are five files deep. Each further file is read at start as a whole.
_MAX_BASE_FILES = 16
# Names of sections begin alike: [USARBot.SICKLMS] is no misspelt [USARBot.SICKLMS200].
_MIN_SIMILARITY = 0.9
_Sections = dict[str, SectionReader]  # by lower-case name


class IniFile:
    """Sections of a file and of its bases, merged by name regardless of case."""

    def __init__(
        self,
        path: Path,
        kind: FileKind = "robots",
        *,
        view_limit_bytes: int = DEFAULT_LIMIT_BYTES,
        text: str | None = None,
    ) -> None:
        """Read the file and its bases ([Configuration] BasedOn=, as in UDK).

        Several BasedOn= are read in their order: a robot, then its camera.

        Args:
            path: the file.
            kind: kind of bundled files whose bare names BasedOn= accepts.
            view_limit_bytes: memory that the view of each camera in the file may take.
            text: content in place of the file's, which may be of another format.

        Raises:
            ConfigError: for an unreadable file, a line outside the grammar, files that are based on
                each other, or too many of them.
        """
        self.path = path
        self.view_limit_bytes = view_limit_bytes
        self._sections: _Sections = {}
        self._absent: dict[str, str] = {}  # names of requested sections, by lower-case name
        seen = {path.resolve()}
        # Bases first: each file overrides its own.
        for sections in _read_files(path, kind, seen, text=text):
            self._apply(sections)
        self.paths = tuple(sorted(seen))
        """Resolved paths of the file and of its bases."""

    def _apply(self, sections: _Sections) -> None:
        for key, settings in sections.items():
            if key in self._sections:
                self._sections[key].apply_overrides(settings)
            else:
                self._sections[key] = settings

    def get_section(self, name: str) -> SectionReader:
        """Section by name; for an absent one an empty reader whose errors name the file."""
        found = self._sections.get(name.lower())
        if found is not None:
            return found
        self._absent[name.lower()] = name
        where, absence = SourceLocation(str(self.path)), f"there is no section [{name}]"
        if misspelt := suggest_name(name, self.section_names(), _MIN_SIMILARITY):
            where = self._sections[misspelt.lower()].where
            absence += f"; is [{misspelt}] meant to be it?"
        return SectionReader(name, where, (), absence=absence)

    def has_section(self, name: str) -> bool:
        """Whether the file or one of its bases has the section."""
        return name.lower() in self._sections

    def sections(self) -> list[SectionReader]:
        """All sections, base files first."""
        return [*self._sections.values()]

    def section_names(self) -> list[str]:
        """Names of all sections as written, base files first."""
        return [settings.name for settings in self._sections.values()]

    def unknown_names(self) -> list[UnknownName]:
        """Unknown keys of sections that were read, and sections that should have been."""
        # A section that no reader opened belongs to a class without meaning here, such as another
        # robot's sensors in a real USARBot.ini: warnings for all keys would hide a misspelt one.
        unknown: list[UnknownName] = []
        for section in self._sections.values():
            if section.is_used:
                unknown += section.unknown_names()
                continue
            suggestion = suggest_name(section.name, self._absent.values(), _MIN_SIMILARITY)
            if suggestion or is_own_section(section.name):
                unknown.append(UnknownName("", "", section.where, section.name, suggestion))
        return unknown


def _read_files(
    path: Path,
    kind: FileKind,
    seen: set[Path],
    dependents: tuple[Path, ...] = (),
    *,
    text: str | None = None,
) -> list[_Sections]:
    """Sections of the bases of a file, then of the file; each file once.

    Args:
        path: the file.
        kind: kind of bundled files.
        seen: resolved paths of all files read so far, this one included.
        dependents: resolved paths of the files that are based on it, directly or not.
        text: content in place of the file's.
    """
    files: list[_Sections] = []
    parsed = read_sections(path) if text is None else parse_sections(text, file=str(path))
    sections = _merge_sections(parsed)
    # Resolved, since a link or a relative path would hide a cycle.
    dependents = (*dependents, path.resolve())
    configuration = sections.get("configuration")
    if configuration is not None and configuration.has_key("BasedOn"):
        for base in configuration.get_paths("BasedOn", path.parent, bundled=kind):
            if base.resolve() in dependents:
                raise configuration.make_error(
                    "BasedOn", expected="a file that is not based on this"
                )
            # Read once: a base that two files share would else undo what the first has changed.
            if base.resolve() in seen:
                continue
            if len(seen) > _MAX_BASE_FILES:
                raise configuration.make_error(
                    "BasedOn", expected=f"at most {_MAX_BASE_FILES} files below the first"
                )
            seen.add(base.resolve())
            files += _read_files(base, kind, seen, dependents)
    return [*files, sections]


def _merge_sections(sections: tuple[Section, ...]) -> _Sections:
    merged: _Sections = {}
    for section in sections:
        # A section may occur twice in Unreal's grammar: the lines of both form one.
        known = merged.get(section.name.lower())
        if known is None:
            merged[section.name.lower()] = SectionReader(
                section.name, section.where, section.entries
            )
        else:
            for entry in section.entries:
                known.apply(entry)
    return merged
