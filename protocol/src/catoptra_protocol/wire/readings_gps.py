"""SEN of a GPS receiver: degrees and minutes, as in NMEA sentences."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.wire import fields
from catoptra_protocol.wire.dialect import Dialect, udk_time
from catoptra_protocol.wire.grammar import Message, Pairs

_UNITS_PER_DEGREE = 600_000  # of 1e-4 minutes, the last place that is printed


@dataclass(frozen=True, slots=True)
class GpsReading:
    """Where on Earth the receiver is; north and east are positive. Without a fix: nowhere.

    UDK prints its time, if there is one: by default there is none.
    """

    WORD: ClassVar[str] = "SEN"

    name: str
    latitude_deg: float = 0.0
    longitude_deg: float = 0.0
    fix: bool = False
    satellites: int = 0
    time_s: float | None = None

    @classmethod
    def from_message(cls, message: Message) -> GpsReading:
        """Return the reading of a parsed line."""
        name, satellites = fields.text(message, "Name"), fields.integer(message, "Satellites")
        time_s = fields.optional_number(message, "Time")
        if not fields.boolean(message, "Fix"):
            return cls(name, satellites=satellites, time_s=time_s)
        return cls(
            name=name,
            latitude_deg=_degrees(message, "Latitude", "NS"),
            longitude_deg=_degrees(message, "Longitude", "EW"),
            fix=True,
            satellites=satellites,
            time_s=time_s,
        )

    def messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Return the line, the same in both dialects but for the time."""
        place = () if not self.fix else self._place()
        fix = (("Fix", str(int(self.fix))), ("Satellites", str(self.satellites)))
        head = (*udk_time(self.time_s, dialect), ("Type", "GPS"), ("Name", self.name))
        return (Message(self.WORD, (*head, *place, *fix)),)

    def _place(self) -> Pairs:
        latitude = _degrees_and_minutes(self.latitude_deg, "NS")
        return ("Latitude", latitude), ("Longitude", _degrees_and_minutes(self.longitude_deg, "EW"))


def _degrees_and_minutes(angle_deg: float, sides: str) -> str:
    """Return `39,8.0341,N`, truncated.

    Rounded at 1e-5 of the last place first, a thousand times the noise of a double there: an angle
    that was read prints as it was.
    """
    if not abs(angle_deg) <= 180.0:
        raise LocalProtocolError(f"GPS: {angle_deg!r} degrees cannot be sent: at most 180")
    units = int(round(abs(angle_deg) * _UNITS_PER_DEGREE, 5))
    degrees, rest = divmod(units, _UNITS_PER_DEGREE)
    return f"{degrees},{rest // 10_000}.{rest % 10_000:04d},{sides[angle_deg < 0.0]}"


def _degrees(message: Message, name: str, sides: str) -> float:
    degrees, minutes, side = _three(message, name)
    parts = Message(message.word, ((name, degrees), (f"{name}Minutes", minutes)))
    angle = fields.number(parts, name) + fields.number(parts, f"{name}Minutes") / 60.0
    if side not in tuple(sides) or not 0.0 <= angle <= 180.0:
        raise RemoteProtocolError(
            f"SEN: {{{name} {fields.text(message, name)[:80]}}}: expected at most 180 degrees and "
            f"one of {', '.join(sides)}"
        )
    return -angle if side == sides[1] else angle


def _three(message: Message, name: str) -> tuple[str, str, str]:
    value = fields.text(message, name)
    parts = value.split(",")
    if len(parts) != 3:
        raise RemoteProtocolError(
            f"SEN: {{{name} {value[:80]}}}: expected degrees,minutes,side as in 39,8.0341,N"
        )
    degrees, minutes, side = parts
    return degrees, minutes, side
