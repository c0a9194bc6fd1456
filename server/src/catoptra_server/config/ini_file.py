"""An ini file as a whole: its sections, merged by name, over those of the file it is based on."""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.errors import Where
from catoptra_server.config.settings import Settings
from catoptra_server.config.unreal_ini import Entry, Section, read_sections


class IniFile:
    """All sections of a file and of the files that it is based on, merged by name."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._sections: dict[str, Settings] = {}
        self._load(path, seen=())

    def _load(self, path: Path, seen: tuple[Path, ...]) -> None:
        """Load what the file is based on ([Configuration] BasedOn=, as in UDK), then the file."""
        sections = _merged(read_sections(path))
        configuration = sections.get("configuration")
        if configuration is not None and configuration.has("BasedOn"):
            base = configuration.file("BasedOn", path.parent)
            if base.resolve() in seen or base.resolve() == path.resolve():
                raise configuration.complain("BasedOn", expected="a file that is not based on this")
            self._load(base, (*seen, path.resolve()))
        for key, settings in sections.items():
            if key in self._sections:
                self._sections[key].overlay(settings)
            else:
                self._sections[key] = settings

    def section(self, name: str) -> Settings:
        """Return a section; one that the file does not have is empty."""
        return self._sections.get(name.lower()) or Settings(name, Where(str(self.path)), ())

    def has(self, name: str) -> bool:
        """Return whether the file has the section."""
        return name.lower() in self._sections

    def names(self) -> list[str]:
        """Return the names of all sections, in order."""
        return [settings.name for settings in self._sections.values()]

    def unknown(self) -> list[Entry]:
        """Return the entries of sections that were used, whose keys nobody asked for."""
        return [
            entry
            for settings in self._sections.values()
            if settings.is_used
            for entry in settings.unknown()
        ]


def _merged(sections: tuple[Section, ...]) -> dict[str, Settings]:
    merged: dict[str, Settings] = {}
    for section in sections:
        known = merged.get(section.name.lower())
        if known is None:
            merged[section.name.lower()] = Settings(section.name, section.where, section.entries)
        else:
            for entry in section.entries:
                known.add(entry)
    return merged
