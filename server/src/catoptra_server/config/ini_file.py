"""An ini file with the files it is based on: one reader for each section name."""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.errors import SourceLocation
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.unreal_ini import Entry, Section, read_sections


class IniFile:
    """Sections of a file and of the files it is based on, merged by name regardless of case."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._sections: dict[str, SectionReader] = {}
        self._load(path, ancestors=())

    def _load(self, path: Path, ancestors: tuple[Path, ...]) -> None:
        """Load the base file ([Configuration] BasedOn=, as in UDK), then apply this file to it."""
        sections = _merge_sections(read_sections(path))
        configuration = sections.get("configuration")
        if configuration is not None and configuration.has_key("BasedOn"):
            base = configuration.get_path("BasedOn", path.parent)
            # Resolved, since a link or a relative path would hide a cycle.
            if base.resolve() in ancestors or base.resolve() == path.resolve():
                raise configuration.make_error(
                    "BasedOn", expected="a file that is not based on this"
                )
            self._load(base, (*ancestors, path.resolve()))
        for key, settings in sections.items():
            if key in self._sections:
                self._sections[key].apply_overrides(settings)
            else:
                self._sections[key] = settings

    def get_section(self, name: str) -> SectionReader:
        """Section by name; for an absent one an empty reader whose errors name the file."""
        return self._sections.get(name.lower()) or SectionReader(
            name, SourceLocation(str(self.path)), ()
        )

    def has_section(self, name: str) -> bool:
        """Whether the file, or one it is based on, has the section."""
        return name.lower() in self._sections

    def section_names(self) -> list[str]:
        """Names of all sections as written, those of base files first."""
        return [settings.name for settings in self._sections.values()]

    def unknown_entries(self) -> list[Entry]:
        """Entries with unknown keys, in sections that were read."""
        # A section that no reader opened belongs to a class without meaning here, such as another
        # robot's sensors in a real USARBot.ini: warnings for all keys would hide a misspelt one.
        return [
            entry
            for settings in self._sections.values()
            if settings.is_used
            for entry in settings.unknown_entries()
        ]


def _merge_sections(sections: tuple[Section, ...]) -> dict[str, SectionReader]:
    merged: dict[str, SectionReader] = {}
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
