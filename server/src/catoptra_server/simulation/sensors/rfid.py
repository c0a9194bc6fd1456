"""An RFID reader: the numbers of all tags in range."""

from __future__ import annotations

from catoptra_protocol.optics.elementary import hypot
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.readings import RfidReading
from catoptra_protocol.usarsim.reports import Configuration
from catoptra_protocol.usarsim.value_format import format_fixed_point
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.simulation.robot_description import DriveBase, Mount
from catoptra_server.simulation.sensors import (
    ConfiguredSensor,
    MotionStep,
    SensorContext,
    SensorKind,
)


@dataclass(frozen=True, slots=True)
class RfidDescription:
    """An RFID reader."""

    name: str
    interval_s: float
    mount: Mount
    max_range_m: float


class _RfidSensor:
    """Tags in range, in the order of the world file."""

    def __init__(
        self, description: RfidDescription, base: DriveBase, random_source: RandomSource
    ) -> None:
        self._description = description
        self._robot_from_reader = description.mount.parent_from_item()

    def update(self, motion: MotionStep) -> None:
        """Nothing to integrate: tags are found at one time."""

    def read(self, context: SensorContext) -> RfidReading:
        """Numbers of the tags in range."""
        # Distances are between points: tags have no extent in the world file.
        reader = context.world_from_robot.transform_points(self._robot_from_reader.translation)
        # No line of sight: radio waves pass through walls.
        ids = tuple(
            tag.number
            for tag in context.environment.rfid_tags
            if hypot(*(reader - tag.position_m)) <= self._description.max_range_m
        )
        return RfidReading(context.time_s, self._description.name, ids)


def _read_description(item: ConfiguredSensor) -> RfidDescription:
    return RfidDescription(item.name, item.interval_s, item.mount, item.get_float("MaxRange", 6.0))


def _configure(reader: RfidDescription) -> Configuration:
    max_range = format_fixed_point(reader.max_range_m)
    return Configuration("RFID", (("Name", reader.name), ("MaxRange", max_range)))


RFID = SensorKind(
    "RFID",
    RfidDescription,
    _RfidSensor,
    {"rfidsensor": _read_description, "rfid": _read_description},
    _configure,
)
