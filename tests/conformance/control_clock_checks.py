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
from conformance.control_session import (
    REPORT_TIMEOUT_S,
    ControlSession,
    ReceivedLine,
    spawn_robot,
)

# Between the first and the last status: some reports; time for the battery to lose two seconds.
_CLOCK_S = 1.2
_BATTERY_S = 2.2
# Reports of another kind over a shorter time are too few to judge.
_MIN_ELAPSED_S = 0.9
# A server that is busy may run slower than real time, and make up for some of it.
_RATE_RANGE = (0.4, 1.6)
_JITTER_S = 0.3
# Times since the start of a level stay below ten days; since 1970 they are above 1.7e9 s.
_MAX_TIME_S = 864_000.0


@retry_once
def check_clock(server: ServerUnderTest) -> None:
    """Time of each kind of report runs as the wall clock does, from the start of the level."""
    with spawn_robot(server) as session:
        _read_status_for(session, _CLOCK_S)
        lines = [line for line in session.lines if line.message.get("Time") is not None]
    kinds = {("STA", "")} | {(line.message.word, line.sensor_type) for line in lines}
    for kind in sorted(kinds):
        own = [line for line in lines if (line.message.word, line.sensor_type) == kind]
        if not own:
            raise CheckFailed("no STA with a Time")
        if own[-1].received_s - own[0].received_s >= _MIN_ELAPSED_S:
            _require_rate(" ".join(kind).strip(), own[0], own[-1])


@retry_once
def check_battery(server: ServerUnderTest) -> None:
    """Battery of STA is positive and falls by a second each second (UT2004)."""
    if server.dialect == "udk":
        raise CheckSkipped("UDK simulates no battery")
    with spawn_robot(server) as session:
        first, last = _read_status_for(session, _BATTERY_S)
    battery_s = read_number(first.message, "Battery")
    fall_s = battery_s - read_number(last.message, "Battery")
    elapsed_s = last.received_s - first.received_s
    # Whole seconds: the fall may differ by one from the time that passed, which is above two.
    if battery_s <= 0.0 or not 1.0 <= fall_s < _RATE_RANGE[1] * elapsed_s + 1.0:
        raise CheckFailed(
            f"Battery {battery_s:g} fell by {fall_s:g} in {elapsed_s:.1f} s: expected a positive "
            "number of seconds that falls by one each second"
        )


def _read_status_for(
    session: ControlSession, duration_s: float
) -> tuple[ReceivedLine, ReceivedLine]:
    """First status of a robot, and one that arrived at least a duration later."""

    def find_ends() -> tuple[ReceivedLine, ReceivedLine]:
        lines = [line for line in session.lines if line.message.word == "STA"]
        return lines[0], lines[-1]

    def is_complete() -> bool:
        first, last = find_ends()
        return last.received_s - first.received_s >= duration_s

    if not session.read_until(is_complete, duration_s + REPORT_TIMEOUT_S):
        raise CheckFailed(f"no STA {duration_s:g} s after the first one")
    return find_ends()


def _require_rate(kind: str, first: ReceivedLine, last: ReceivedLine) -> None:
    """Fail unless time passes between two reports as on the wall clock."""
    start_s, end_s = (read_number(line.message, "Time") for line in (first, last))
    elapsed_s = last.received_s - first.received_s
    if end_s > _MAX_TIME_S:
        raise CheckFailed(f"{kind}: Time {end_s:g}: expected seconds since the level started")
    slow, fast = _RATE_RANGE
    if not slow * elapsed_s - _JITTER_S < end_s - start_s < fast * elapsed_s + _JITTER_S:
        raise CheckFailed(
            f"{kind}: Time grew by {end_s - start_s:.2f} s in {elapsed_s:.2f} s of the wall clock"
        )


CLOCK_CHECKS = (
    check_from_function("clock", "control", check_clock),
    check_from_function("battery", "control", check_battery),
)
