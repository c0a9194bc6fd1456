"""One sensor of a robot's section as its readers see it: the item and the section of its class."""

from __future__ import annotations

from dataclasses import dataclass

from catoptra_server.config.settings import Settings
from catoptra_server.robot.mount import Mount


@dataclass(frozen=True, slots=True)
class SensorItem:
    """One item: its struct, where it is mounted, and the section of its class."""

    struct: Settings
    name: str
    mount: Mount
    section: Settings

    @property
    def interval_s(self) -> float:
        """Return the period of its class."""
        return self.section.number("ScanInterval", 0.2, at_least=0.01, at_most=60.0)

    def number(self, key: str, default: float, at_most: float = 1e4) -> float:
        """Return a number of its class that is not negative."""
        return self.section.number(key, default, at_least=0.0, at_most=at_most)

    def is_timed(self, default: bool) -> bool:
        """Return whether UDK's readings of its class carry a time. Others than these always do."""
        return self.section.boolean("bWithTimeStamp", default)
