"""What the control server tells a client: one frozen dataclass a message, in UT2004's form.

To add one: write its class (word, fields, `from_message`, `blocks`), then its line in the `Report`
union and in `_READERS`; for a sensor see `readings`. Field order and the number of decimals are
those of real captures: clients index blocks by position.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.wire import fields
from catoptra_protocol.wire.geometry import (
    Geometry,
    GeometryItem,
    VehicleGeometry,
    geometry_from_message,
)
from catoptra_protocol.wire.grammar import Message, Pairs, format_line
from catoptra_protocol.wire.greeting import (
    Greeting,
    StartPose,
    StartPoses,
    greeting_from_message,
)
from catoptra_protocol.wire.limits import MAX_SERVER_LINE_BYTES
from catoptra_protocol.wire.numbers import boolean, fixed
from catoptra_protocol.wire.readings import (
    GroundTruthReading,
    OdometryReading,
    reading_from_message,
)


@dataclass(frozen=True, slots=True)
class VehicleStatus:
    """STA of a skid-steered robot: battery in whole seconds left; view is its tile or -1."""

    WORD: ClassVar[str] = "STA"

    time_s: float
    battery_s: int
    vehicle_type: str = "GroundVehicle"
    light: bool = False
    view: int = -1

    @classmethod
    def from_message(cls, message: Message) -> VehicleStatus:
        """Return the status of a parsed line; UDK's has no View."""
        return cls(
            time_s=fields.number(message, "Time"),
            battery_s=fields.integer(message, "Battery"),
            vehicle_type=fields.text(message, "Type"),
            light=fields.boolean(message, "LightToggle"),
            view=fields.integer(message, "View", default=-1),
        )

    def blocks(self) -> Pairs:
        """Return the blocks to send: every one of them is needed by some client."""
        return (
            ("Type", self.vehicle_type),
            ("Time", fixed(self.time_s, 2)),
            ("FrontSteer", fixed(0.0)),
            ("RearSteer", fixed(0.0)),
            ("LightToggle", boolean(self.light)),
            ("LightIntensity", "100" if self.light else "0"),
            ("Battery", str(int(self.battery_s))),
            ("View", str(self.view)),
        )


@dataclass(frozen=True, slots=True)
class Configuration:
    """CONF, the reply to GETCONF: free pairs after the type; none, or a name alone, if empty."""

    WORD: ClassVar[str] = "CONF"

    type: str
    pairs: Pairs = ()

    @classmethod
    def from_message(cls, message: Message) -> Configuration:
        """Return the configuration of a parsed line."""
        others = tuple(pair for pair in message.pairs if pair[0].lower() != "type")
        return cls(fields.text(message, "Type"), others)

    def blocks(self) -> Pairs:
        """Return the blocks to send."""
        return (("Type", self.type), *self.pairs)

    def get(self, name: str) -> str | None:
        """Return the value of the first pair with this name, in any case; None if there is none."""
        return Message(self.WORD, self.pairs).get(name)


@dataclass(frozen=True, slots=True)
class Result:
    """RES, what became of a command: status OK or Failed. The answer to SET and to our STEP."""

    WORD: ClassVar[str] = "RES"

    time_s: float
    type: str
    name: str
    status: str = "OK"

    @classmethod
    def from_message(cls, message: Message) -> Result:
        """Return the result of a parsed line; that of viewports has no name."""
        return cls(
            time_s=fields.number(message, "Time"),
            type=fields.text(message, "Type"),
            name=message.get("Name") or "",
            status=fields.text(message, "Status"),
        )

    def blocks(self) -> Pairs:
        """Return the blocks to send."""
        return (
            ("Time", fixed(self.time_s)),
            ("Type", self.type),
            ("Name", self.name),
            ("Status", self.status),
        )


Report = (
    Greeting
    | StartPoses
    | VehicleStatus
    | OdometryReading
    | GroundTruthReading
    | Configuration
    | Geometry
    | VehicleGeometry
    | Result
)

Reader = Callable[[Message], Report | None]


def line_from_report(report: Report) -> bytes:
    """Return the line of a report.

    Raises LocalProtocolError if it has none, or one longer than clients can read.
    """
    line = format_line(report.WORD, report.blocks())
    if len(line) > MAX_SERVER_LINE_BYTES:
        raise LocalProtocolError(
            f"a line of {len(line)} bytes ({line[:80]!r}...): clients read at most "
            f"{MAX_SERVER_LINE_BYTES}; send fewer items or shorter names"
        )
    return line


def report_from_message(message: Message) -> Report | None:
    """Return the report of a message; None for a word or type that we do not know.

    Raises RemoteProtocolError naming the field that a known one lacks or spells wrongly.
    """
    reader = _READERS.get(message.word)
    return reader(message) if reader else None


_READERS: dict[str, Reader] = {
    "NFO": greeting_from_message,
    "STA": VehicleStatus.from_message,
    "SEN": reading_from_message,
    "CONF": Configuration.from_message,
    "GEO": geometry_from_message,
    "RES": Result.from_message,
}

__all__ = [
    "Configuration",
    "Geometry",
    "GeometryItem",
    "Greeting",
    "GroundTruthReading",
    "OdometryReading",
    "Report",
    "Result",
    "StartPose",
    "StartPoses",
    "VehicleGeometry",
    "VehicleStatus",
    "line_from_report",
    "report_from_message",
]
