"""One sensor of a robot's section as its readers see it: the item and the section of its class."""

from __future__ import annotations

from dataclasses import dataclass

from catoptra_server.config.section_reader import SectionReader
from catoptra_server.robot.mount import Mount


@dataclass(frozen=True, slots=True)
class SensorItem:
    """One item: its struct, where it is mounted, and the section of its class."""

    struct: SectionReader
    name: str
    mount: Mount
    section: SectionReader

    @property
    def interval_s(self) -> float:
        """Return the period of its class."""
        return self.section.get_float("ScanInterval", 0.2, min_value=0.01, max_value=60.0)

    def get_float(self, key: str, default: float, max_value: float = 1e4) -> float:
        """Return a number of its class that is not negative."""
        return self.section.get_float(key, default, min_value=0.0, max_value=max_value)

    def has_timestamp(self, default: bool) -> bool:
        """Return whether UDK's readings of its class carry a time. Others than these always do."""
        return self.section.get_bool("bWithTimeStamp", default)
