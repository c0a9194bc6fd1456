"""A kind of sensor: everything that the rest of the server needs to read, create and run one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.robot.mount import Mount
from catoptra_server.robot.robot_description import SensorDescription
from catoptra_server.sensors.sensor import Sensor


class SensorKeys(Protocol):
    """Keys of a section or an item of a robot file; an invalid value raises ConfigError."""

    def get_float(self, key: str, default: float, *, min_value: float, max_value: float) -> float:
        """Number within bounds."""

    def get_int(self, key: str, default: int, *, min_value: int, max_value: int) -> int:
        """Whole number within bounds."""

    def get_bool(self, key: str, default: bool) -> bool:
        """Truth value."""

    def get_str(self, key: str, default: str) -> str:
        """Text without quotes."""


class ConfiguredSensor(Protocol):
    """One sensor item of a robot file, with the section of the item's class."""

    @property
    def name(self) -> str:
        """Name of the sensor."""

    @property
    def interval_s(self) -> float:
        """Simulation time between two readings."""

    @property
    def mount(self) -> Mount:
        """Mounting pose."""

    @property
    def struct(self) -> SensorKeys:
        """Keys of the item."""

    @property
    def section(self) -> SensorKeys:
        """Keys of the class, shared by all items of the class."""

    def get_float(self, key: str, default: float, max_value: float = 1e4) -> float:
        """Non-negative number of the class."""

    def has_timestamp(self, default: bool) -> bool:
        """Whether readings in the UDK dialect carry a time, given UDK's default for the class."""


# By protocol: the reader of ini files is in `config`, a layer above sensors.
ReadDescription = Callable[[ConfiguredSensor], SensorDescription]


@dataclass(frozen=True, slots=True, eq=False)
class SensorKind:
    """One row of the table of sensors, defined at the end of the sensor's module."""

    description: type
    """Class of the descriptions."""
    # Any: each kind takes its own description, or a sequence of them where they share a line.
    create: Callable[[Any, Any, Any], Sensor]
    """Makes the sensor of a description, the base and a random source; of a sequence of
    descriptions where `shared_stream` is set."""
    readers: Mapping[str, ReadDescription]
    """Reader of an item's description by class name in lower case: UT2004's names and UDK's."""
    shared_stream: str | None = None
    """Name of the random numbers, where all sensors of a robot report in one line as in USARSim;
    with a space, which no sensor's name has. None where each reports alone, under its own name."""
    casts_rays: bool = False
    """Whether readings measure the scene, which is then prepared before the server listens."""
