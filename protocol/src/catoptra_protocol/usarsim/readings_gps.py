"""SEN of a GPS receiver: degrees and minutes, as in NMEA sentences."""

from __future__ import annotations

from typing import ClassVar

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim import strict_fields
from catoptra_protocol.usarsim.dialect import Dialect, udk_time_pairs
from catoptra_protocol.usarsim.grammar import Message, Pairs

# A tick is 1e-4 minutes, the last printed decimal.
_TICKS_PER_DEGREE = 600_000


@dataclass(frozen=True, slots=True)
class GpsReading:
    """Position of the receiver on Earth."""

    WORD: ClassVar[str] = "SEN"

    name: str
    latitude_deg: float = 0.0
    """North is positive; 0 without a fix."""
    longitude_deg: float = 0.0
    """East is positive; 0 without a fix."""
    has_fix: bool = False
    num_satellites: int = 0
    time_s: float | None = None
    """Printed by UDK only, and there by option; None if unknown."""

    @classmethod
    def from_message(cls, message: Message) -> GpsReading:
        """Parse a line.

        Raises:
            RemoteProtocolError: A field is missing or wrong; names the field.
        """
        name, satellites = (
            strict_fields.read_text(message, "Name"),
            strict_fields.read_integer(message, "Satellites"),
        )
        time_s = strict_fields.read_optional_number(message, "Time")
        if not strict_fields.read_boolean(message, "Fix"):
            return cls(name, num_satellites=satellites, time_s=time_s)
        return cls(
            name=name,
            latitude_deg=_parse_angle(message, "Latitude", "NS"),
            longitude_deg=_parse_angle(message, "Longitude", "EW"),
            has_fix=True,
            num_satellites=satellites,
            time_s=time_s,
        )

    def to_messages(self, dialect: Dialect) -> tuple[Message, ...]:
        """Line, the same in both dialects except for the time."""
        position = () if not self.has_fix else self._position_pairs()
        fix = (("Fix", str(int(self.has_fix))), ("Satellites", str(self.num_satellites)))
        head = (*udk_time_pairs(self.time_s, dialect), ("Type", "GPS"), ("Name", self.name))
        return (Message(self.WORD, (*head, *position, *fix)),)

    def _position_pairs(self) -> Pairs:
        latitude = _format_angle(self.latitude_deg, "NS")
        return ("Latitude", latitude), ("Longitude", _format_angle(self.longitude_deg, "EW"))


def _format_angle(angle_deg: float, hemispheres: str) -> str:
    """Degrees, minutes and hemisphere, `39,8.0341,N`, truncated."""
    if not abs(angle_deg) <= 180.0:
        raise LocalProtocolError(f"GPS: {angle_deg!r} degrees cannot be sent: at most 180")
    # Rounded at 1e-5 of a tick before the truncation, a thousand times the noise of a double there:
    # an angle that was read prints unchanged.
    ticks = int(round(abs(angle_deg) * _TICKS_PER_DEGREE, 5))
    degrees, rest = divmod(ticks, _TICKS_PER_DEGREE)
    return f"{degrees},{rest // 10_000}.{rest % 10_000:04d},{hemispheres[angle_deg < 0.0]}"


def _parse_angle(message: Message, name: str, hemispheres: str) -> float:
    degrees, minutes, side = _split_angle(message, name)
    # Two messages with names of their own, so that an error names degrees or minutes.
    parts = Message(message.word, ((name, degrees), (f"{name}Minutes", minutes)))
    angle = (
        strict_fields.read_number(parts, name)
        + strict_fields.read_number(parts, f"{name}Minutes") / 60.0
    )
    if side not in tuple(hemispheres) or not 0.0 <= angle <= 180.0:
        raise RemoteProtocolError(
            f"SEN: {{{name} {strict_fields.read_text(message, name)[:80]}}}: "
            f"expected at most 180 degrees and one of {', '.join(hemispheres)}"
        )
    return -angle if side == hemispheres[1] else angle


def _split_angle(message: Message, name: str) -> tuple[str, str, str]:
    value = strict_fields.read_text(message, name)
    parts = value.split(",")
    if len(parts) != 3:
        raise RemoteProtocolError(
            f"SEN: {{{name} {value[:80]}}}: expected degrees,minutes,side as in 39,8.0341,N"
        )
    degrees, minutes, side = parts
    return degrees, minutes, side
