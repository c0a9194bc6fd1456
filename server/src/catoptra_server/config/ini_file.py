"""An ini file as a whole: its sections, merged by name, over those of the file it is based on."""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.errors import SourceLocation
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.unreal_ini import Entry, Section, read_sections


class IniFile:
    """All sections of a file and of the files that it is based on, merged by name."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._sections: dict[str, SectionReader] = {}
        self._load(path, seen=())

    def _load(self, path: Path, seen: tuple[Path, ...]) -> None:
        """Load what the file is based on ([Configuration] BasedOn=, as in UDK), then the file."""
        sections = _merge_sections(read_sections(path))
        configuration = sections.get("configuration")
        if configuration is not None and configuration.has_key("BasedOn"):
            base = configuration.get_path("BasedOn", path.parent)
            if base.resolve() in seen or base.resolve() == path.resolve():
                raise configuration.make_error(
                    "BasedOn", expected="a file that is not based on this"
                )
            self._load(base, (*seen, path.resolve()))
        for key, settings in sections.items():
            if key in self._sections:
                self._sections[key].apply_overrides(settings)
            else:
                self._sections[key] = settings

    def get_section(self, name: str) -> SectionReader:
        """Return a section; one that the file does not have is empty."""
        return self._sections.get(name.lower()) or SectionReader(
            name, SourceLocation(str(self.path)), ()
        )

    def has_section(self, name: str) -> bool:
        """Return whether the file has the section."""
        return name.lower() in self._sections

    def section_names(self) -> list[str]:
        """Return the names of all sections, in order."""
        return [settings.name for settings in self._sections.values()]

    def unknown_entries(self) -> list[Entry]:
        """Return the entries of sections that were used, whose keys nobody asked for."""
        return [
            entry
            for settings in self._sections.values()
            if settings.is_used
            for entry in settings.unknown_entries()
        ]


def _merge_sections(sections: tuple[Section, ...]) -> dict[str, SectionReader]:
    merged: dict[str, SectionReader] = {}
    for section in sections:
        known = merged.get(section.name.lower())
        if known is None:
            merged[section.name.lower()] = SectionReader(
                section.name, section.where, section.entries
            )
        else:
            for entry in section.entries:
                known.apply(entry)
    return merged
