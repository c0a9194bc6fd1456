"""One sensor item of a robot's section, together with the section of its class."""

from __future__ import annotations

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.simulation.robot_description import Mount


@dataclass(frozen=True, slots=True)
class SensorItem:
    """Input of a sensor's reader."""

    struct: SectionReader
    """The item itself, such as `(ItemClass=..,ItemName=..)`."""
    name: str
    """ItemName, which clients receive."""
    mount: Mount
    """Pose relative to the chassis or the item's Parent."""
    section: SectionReader
    """Section of the item's class; shared by all items of the class, empty if absent."""

    @property
    def interval_s(self) -> float:
        """Seconds from one reading to the next."""
        return self.section.get_float("ScanInterval", 0.2, min_value=0.01, max_value=60.0)

    def get_float(self, key: str, default: float, max_value: float = 1e4) -> float:
        """Non-negative number of the class's section: a range, a noise, a scale."""
        return self.section.get_float(key, default, min_value=0.0, max_value=max_value)

    def has_timestamp(self, default: bool) -> bool:
        """Whether readings in the UDK dialect carry a time (Odometry, Encoder, Touch, INS, GPS).

        Args:
            default: UDK's own choice for the class, where the section has no bWithTimeStamp.
        """
        return self.section.get_bool("bWithTimeStamp", default)
