"""Checks of time: that of the reports, and the battery, against the wall clock."""

from __future__ import annotations

from conformance.check import (
    CheckFailed,
    CheckSkipped,
    ServerUnderTest,
    check_from_function,
    retry_once,
)
from conformance.control_readings import read_number
from conformance.control_session import ReceivedLine, spawn_robot

# Some reports, and the second in which the battery loses at least one.
_OBSERVATION_S = 1.0
_BATTERY_S = 2.5
# A server that is busy may run slower than real time, and make up for some of it.
_RATE_RANGE = (0.4, 1.6)
_JITTER_S = 0.3
# Times since the start of a level stay below ten days; since 1970 they are above 1.7e9 s.
_MAX_TIME_S = 864_000.0


@retry_once
def check_clock(server: ServerUnderTest) -> None:
    """Time of each kind of report runs as the wall clock does, from the start of the level."""
    with spawn_robot(server) as session:
        session.read_for(_OBSERVATION_S)
        lines = [line for line in session.lines if line.message.get("Time") is not None]
    kinds = {(line.message.word, line.sensor_type) for line in lines}
    if ("STA", "") not in kinds:
        raise CheckFailed("no STA with a Time")
    for kind in sorted(kinds):
        own = [line for line in lines if (line.message.word, line.sensor_type) == kind]
        _require_rate(" ".join(kind).strip(), own)


@retry_once
def check_battery(server: ServerUnderTest) -> None:
    """Battery of STA is positive and falls by a second each second (UT2004)."""
    if server.dialect == "udk":
        raise CheckSkipped("UDK simulates no battery")
    with spawn_robot(server) as session:
        session.read_for(_BATTERY_S)
        lines = [line for line in session.lines if line.message.word == "STA"]
    first, last = lines[0], lines[-1]
    battery_s = read_number(first.message, "Battery")
    fall_s = battery_s - read_number(last.message, "Battery")
    elapsed_s = last.received_s - first.received_s
    _, fast = _RATE_RANGE
    # Whole seconds: the fall may differ by one from the time that passed, which is above two.
    if battery_s <= 0.0 or not 1.0 <= fall_s < fast * elapsed_s + 1.0:
        raise CheckFailed(
            f"Battery {battery_s:g} fell by {fall_s:g} in {elapsed_s:.1f} s: expected a positive "
            "number of seconds that falls by one each second"
        )


def _require_rate(kind: str, lines: list[ReceivedLine]) -> None:
    """Fail unless time passes in these reports as on the wall clock."""
    first, last = lines[0], lines[-1]
    start_s, end_s = (read_number(line.message, "Time") for line in (first, last))
    if end_s > _MAX_TIME_S:
        raise CheckFailed(
            f"{kind}: a Time of {end_s:g} s: expected seconds since the level started"
        )
    elapsed_s = last.received_s - first.received_s
    slow, fast = _RATE_RANGE
    if elapsed_s < 0.5 * _OBSERVATION_S:
        raise CheckFailed(f"{kind}: {len(lines)} reports in {_OBSERVATION_S:g} s")
    if not slow * elapsed_s - _JITTER_S < end_s - start_s < fast * elapsed_s + _JITTER_S:
        raise CheckFailed(
            f"{kind}: Time grew by {end_s - start_s:.2f} s in {elapsed_s:.2f} s of the wall clock"
        )


CLOCK_CHECKS = (
    check_from_function("clock", "control", check_clock),
    check_from_function("battery", "control", check_battery),
)
