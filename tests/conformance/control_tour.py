"""A tour of one robot, recorded: every report of it, standing, turning, driving and commanded.

Checks by physics look at the recording (control_tour_checks.py), so that all of them take the time
of one drive, and so that a mutated recording can be checked without a server. Commands of the tour
do not depend on the numbers of replies but for a very fast robot: speeds are percent of MaxSpeed.
Source: SPEC.md 4 to 6.
"""

from __future__ import annotations

import itertools
import math
import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import zmq

from catoptra_protocol.stream.messages import bytes_from_message, reply_from_bytes
from catoptra_protocol.stream.replies import CameraReply, Heartbeat
from catoptra_protocol.stream.requests import GetCameraRequest
from catoptra_protocol.usarsim.grammar import Message, items_from_message
from catoptra_protocol.vectors import Vector3
from conformance.check import CheckFailed, ServerUnderTest
from conformance.control_drive import STAND, drive_until, require_sides
from conformance.control_forms import READING_FORMS
from conformance.control_readings import read_number, read_numbers
from conformance.control_session import (
    REPORT_TIMEOUT_S,
    ControlSession,
    ReceivedLine,
    spawn_robot,
)

PART_TYPES = (
    *("RangeScanner", "Sonar", "INS", "Odometry", "Encoder", "Tachometer", "Touch", "RFID"),
    *("VictSensor", "GroundTruth", "GPS", "Camera", "MisPkg"),
)
# Less for a robot that would leave its room within a report or two.
_SPEED_PERCENT, _MAX_SPEED_M_S = 50.0, 0.5
LINK_VALUES = (0.2, -0.15)
"""Commanded value of the first two links of a mission package, and of each further joint."""
FOV_RAD = 0.6
_TURN_RAD = 1.0
_FORWARD_M = 0.4
# Twice the time of joints of 0.17 rad/s.
_JOINTS_S = 2.4
# A scanner that reports on demand takes one interval; intervals are tenths of seconds.
_SCAN_S = 2.0
_STANDING_S = 0.5
_MAX_VISITS = 4
_VISIT_S = 0.6
_REPORT_WORDS = ("SEN", "STA", "MISSTA", "ASTA")


@dataclass(frozen=True, slots=True)
class Instant:
    """Reports of one instant, which are sent together."""

    time_s: float
    """Median of the Time of its reports."""
    received_s: float
    reports: tuple[Message, ...]

    def find(self, type_: str) -> list[Message]:
        """Reports of a type, `sta` among them, in lower case."""
        return [one for one in self.reports if _type_of(one) == type_]


@dataclass(frozen=True)
class Tour:
    """Lines of a robot, from the greeting to its last report."""

    server: ServerUnderTest
    lines: tuple[ReceivedLine, ...]
    marks: dict[str, tuple[int, int]]
    """First line of each phase, and the one behind its last."""
    cameras: dict[str, tuple[dict[str, str], Vector3]] = field(default_factory=dict)
    """Model of each camera by the stream of the same server, and its place on the robot; empty
    without a stream.
    """
    visits: tuple[tuple[str, tuple[ReceivedLine, ...]], ...] = ()
    """Name of a start pose and the lines of a robot there."""
    speed_percent: float = _SPEED_PERCENT
    """Of all drives."""

    @property
    def dialect(self) -> str:
        """`ut2004` or `udk`."""
        return self.server.dialect

    @cached_property
    def messages(self) -> tuple[Message, ...]:
        """All lines."""
        return tuple(line.message for line in self.lines)

    @cached_property
    def instants(self) -> tuple[Instant, ...]:
        """All reports."""
        return tuple(_iter_instants(self.lines))

    def instants_of(self, phase: str) -> list[Instant]:
        """Reports of a phase; that of a motion begins and ends while the robot stands."""
        first, last = self.marks[phase]
        return list(_iter_instants(self.lines[first:last]))

    def find_replies(self, word: str, type_: str, phase: str = "query") -> list[Message]:
        """Each part in the replies to GETCONF or GETGEO of a type, as a message of its own."""
        first, last = self.marks[phase]
        found = [
            one.message
            for one in self.lines[first:last]
            if one.message.word == word
            and _type_of(one.message) == type_
            # An empty reply has the type alone.
            and len(one.message.pairs) > 1
        ]
        return [
            item for one in found for item in (items_from_message(one) if word == "GEO" else [one])
        ]

    def find_robot(self, word: str) -> Message:
        """CONF or GEO of the robot itself."""
        key = "SteeringType" if word == "CONF" else "Dimensions"
        for message in self.messages:
            if message.word == word and message.get(key) is not None:
                return message
        raise CheckFailed(f"GET{word} {{Type Robot}}: no {word} with a {key}")

    def map_lines(self, make_change: Callable[[], Callable[[str], str]]) -> Tour:
        """Tour with a change of each line, to any number; a new one for each connection."""
        mapped = _map_lines(self.lines, make_change())
        starts = [0, *itertools.accumulate(map(len, mapped))]
        return replace(
            self,
            lines=tuple(itertools.chain(*mapped)),
            marks={name: (starts[a], starts[b]) for name, (a, b) in self.marks.items()},
            visits=tuple(
                (name, tuple(itertools.chain(*_map_lines(lines, make_change()))))
                for name, lines in self.visits
            ),
        )


def record_tour(server: ServerUnderTest) -> Tour:
    """Drive a robot of the server, and record all of its lines.

    Raises:
        CheckFailed: It neither reports nor moves.
        CheckSkipped: It does not steer by the speeds of its sides.
    """
    marks: dict[str, tuple[int, int]] = {}
    with spawn_robot(server) as session:
        _record(session, marks, _standing_phases(session))
        require_sides(session)
        percent = _speed_percent(Tour(server, tuple(session.lines), marks))
        drives = (
            *(("right", percent, -percent), ("first", percent, percent)),
            *(("left", -percent, percent), ("second", percent, percent)),
        )
        _record(session, marks, {name: partial(_drive, session, *signs) for name, *signs in drives})
        phases = {
            "joints": lambda: _move_joints(session),
            "light": lambda: _send_and_read(session, "DRIVE {Light true}"),
            "camera": lambda: _set_field_of_view(session),
            "reset": lambda: _reset_odometry(session),
        }
        _record(session, marks, phases)
        lines = tuple(session.lines)
    tour = Tour(server, lines, marks, speed_percent=percent)
    names = [one.get("Name") or "" for one in tour.find_replies("CONF", "camera")]
    return replace(tour, cameras=_read_cameras(server, filter(None, names)))


def record_standing(server: ServerUnderTest) -> Tour:
    """The start of a tour, of a robot that may steer in any way."""
    marks: dict[str, tuple[int, int]] = {}
    with spawn_robot(server) as session:
        _record(session, marks, _standing_phases(session))
        return Tour(server, tuple(session.lines), marks)


def record_visits(tour: Tour) -> Tour:
    """The tour with robots at some start poses, which must be free, one after the other."""
    return replace(tour, visits=tuple(_visit_start_poses(tour)))


def number_of(message: Message, name: str) -> float | None:
    """Number of a field; None where the server has none.

    Raises:
        CheckFailed: It is no plain decimal.
    """
    return None if message.get(name) is None else read_number(message, name)


def _type_of(message: Message) -> str:
    return "sta" if message.word == "STA" else (message.get("Type") or message.word).lower()


def _map_lines(
    lines: Iterable[ReceivedLine], change: Callable[[str], str]
) -> list[list[ReceivedLine]]:
    """Lines in the place of each."""
    mapped = []
    for line in lines:
        text = change(line.text)
        parts = [part for part in text.split("\r\n") if part]
        mapped.append([line] if text == line.text else [line.with_text(part) for part in parts])
    return mapped


def _iter_instants(lines: Iterable[ReceivedLine]) -> Iterator[Instant]:
    """Group reports: STA is the last one of an instant, and no sensor reports twice in one."""
    reports: dict[tuple[str, str, str], Message] = {}
    received_s = 0.0
    for line in lines:
        message = line.message
        if message.word not in _REPORT_WORDS:
            continue
        key = message.word, _type_of(message), (message.get("Name") or "").partition(" ")[0]
        if key in reports:
            yield _make_instant(reports, received_s)
            reports = {}
        reports[key], received_s = message, line.received_s
        if message.word == "STA":
            yield _make_instant(reports, received_s)
            reports = {}
    # Reports without the rest of their instant are left out.


def _make_instant(reports: dict[tuple[str, str, str], Message], received_s: float) -> Instant:
    times = {
        key[:2]: time_s
        for key, one in reports.items()
        if (time_s := number_of(one, "Time")) is not None
    }
    time_s = statistics.median_low(times.values()) if times else math.nan
    return Instant(time_s, received_s, tuple(reports.values()))


def _record(
    session: ControlSession,
    marks: dict[str, tuple[int, int]],
    phases: Mapping[str, Callable[[], object]],
) -> None:
    """Run phases, and mark the lines of each."""
    for name, run in phases.items():
        first = len(session.lines)
        run()
        marks[name] = first, len(session.lines)


def _standing_phases(session: ControlSession) -> dict[str, Callable[[], object]]:
    queries = [f"GET{w} {{Type {t}}}" for t in ("Robot", *PART_TYPES) for w in ("CONF", "GEO")]
    return {
        "stand": lambda: session.read_for(_STANDING_S),
        "query": lambda: session.query(*queries),
        "scan": lambda: _scan_on_demand(session),
    }


def _scan_on_demand(session: ControlSession) -> None:
    """Request the readings of sensors that do not report by themselves."""

    def missing() -> set[str]:
        types = {_type_of(one.message) for one in session.lines if one.message.word == "CONF"}
        reported = {line.sensor_type for line in session.lines}
        return (types & set(READING_FORMS[session.dialect])) - reported

    for one in [line.message for line in session.lines]:
        if one.word == "CONF" and one.get("Name") and _type_of(one) in missing():
            session.send(
                f"SET {{Type {one.get('Type')}}} {{Name {one.get('Name')}}} {{Opcode SCAN}}"
            )
    session.read_until(lambda: not missing(), _SCAN_S)


def _speed_percent(tour: Tour) -> float:
    conf, geo = tour.find_robot("CONF"), tour.find_robot("GEO")
    fastest_m_s = read_number(conf, "MaxSpeed") * read_number(geo, "WheelRadius")
    return min(_SPEED_PERCENT, 100.0 * _MAX_SPEED_M_S / max(fastest_m_s, 1e-3))


def _drive(session: ControlSession, left: float, right: float) -> None:
    turn_rad, forward_m = (_TURN_RAD, math.inf) if left != right else (math.inf, _FORWARD_M)
    # Back over the first turn, and as far on the other side.
    turn_rad *= 2.0 if left < right else 1.0
    drive_until(
        session,
        left,
        right,
        lambda motion: abs(motion.yaw_rad) >= turn_rad or motion.distance_m >= forward_m,
    )
    session.read_next_cycle()


def _move_joints(session: ControlSession) -> None:
    """Move the first links of each mission package, and all joints in the status."""
    commands = []
    for name in sorted(
        {
            one.message.get("Name") or ""
            for one in session.lines
            if one.message.word in ("MISSTA", "ASTA")
        }
    ):
        links = " ".join(
            f"{{Link {i}}} {{Value {value}}}" for i, value in enumerate(LINK_VALUES, start=1)
        )
        commands.append(f"MISPKG {{Name {name}}} {links}")
    status = next(one.message for one in reversed(session.lines) if one.message.word == "STA")
    commands += [
        f"DRIVE {{Name {name}}} {{Value {LINK_VALUES[0]}}}" for name in joint_names(status)
    ]
    if commands:
        session.send(*commands)
        session.read_for(_JOINTS_S)


def joint_names(status: Message) -> list[str]:
    """Joints of the robot itself in an STA."""
    standard = "time type battery view frontsteer rearsteer lighttoggle lightintensity".split()
    return [name for name, _ in status.pairs if name.lower() not in standard]


def _send_and_read(session: ControlSession, command: str) -> None:
    session.send(command)
    session.read_next_cycle()
    session.read_next_cycle()


def _set_field_of_view(session: ControlSession) -> None:
    """Set that of the first camera without a mirror or a lens, within its range."""
    for one in session.query("GETCONF {Type Camera}"):
        if one.get("Name") and one.get("Mirror") is None and one.get("Lens") is None:
            session.query(f"SET {{Type Camera}} {{Name {one.get('Name')}}} {{FOV {FOV_RAD}}}")
            break
    session.query("GETCONF {Type Camera}")


def _reset_odometry(session: ControlSession) -> None:
    names = {one.message.get("Name") for one in session.lines if one.sensor_type == "odometry"}
    for name in names:
        session.query(f"SET {{Type Odometry}} {{Name {name}}} {{Opcode RESET}}")
    _send_and_read(session, STAND)


def _read_cameras(
    server: ServerUnderTest, names: Iterable[str]
) -> dict[str, tuple[dict[str, str], Vector3]]:
    """Models of cameras by the stream, the second source of their CONF and GEO."""
    if "stream" not in server.addresses:
        return {}
    cameras = {}
    with zmq.Context() as context, context.socket(zmq.DEALER) as connection:
        connection.set(zmq.LINGER, 0)
        connection.connect("tcp://{}:{}".format(*server.addresses["stream"]))
        for number, name in enumerate(names, start=1):
            connection.send(bytes_from_message(GetCameraRequest(number, name)))
            while connection.poll(1000.0 * REPORT_TIMEOUT_S):
                reply = reply_from_bytes(connection.recv_multipart()[0])
                if isinstance(reply, CameraReply) and server.robot_class.endswith(reply.class_name):
                    cameras[name] = reply.camera_model, reply.robot_from_mirror.position_m
                if not isinstance(reply, Heartbeat):
                    break
    return cameras


def _visit_start_poses(tour: Tour) -> Iterator[tuple[str, tuple[ReceivedLine, ...]]]:
    """Iterate over names and lines."""
    poses = start_poses(tour.messages)
    for name in list(poses)[-_MAX_VISITS:]:
        with spawn_robot(tour.server, f"{{Start {name}}}") as session:
            session.read_for(_VISIT_S)
            yield name, tuple(session.lines)


def start_poses(messages: Iterable[Message]) -> dict[str, tuple[float, ...]]:
    """Location and orientation of each start pose, of the first reply to GETSTARTPOSES."""
    message = next((one for one in messages if one.get("StartPoses") is not None), None)
    words = " ".join(" ".join(pair) for pair in message.pairs[1:]).split() if message else []
    # MOAST has keys between them.
    words = [word for word in words if word not in ("Name", "Location", "Orientation")]
    poses = {}
    for name, location, orientation in zip(words[::3], words[1::3], words[2::3], strict=True):
        message = Message("NFO", (("Location", location), ("Orientation", orientation)))
        poses[name] = (
            *read_numbers(message, "Location", 3),
            *read_numbers(message, "Orientation", 3),
        )
    return poses
