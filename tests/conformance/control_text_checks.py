"""Checks of the text of the control port: line ends, spaces, plain decimals, fields of each line.

What is checked is what some known client depends on (SPEC.md 3, 5): the line end, the length, one
space between blocks, positions of blocks, numbers without exponents.
"""

from __future__ import annotations

import re

from catoptra_protocol.usarsim.grammar import Message
from conformance.check import CheckFailed, ServerUnderTest, check_from_function
from conformance.control_forms import (
    CONFIGURATION_FORMS,
    LISTED_TYPES,
    PART_GEOMETRY_FORMS,
    READING_FORMS,
    ROBOT_GEOMETRY_FORM,
    matches_form,
)
from conformance.control_readings import find_item_names, read_number, read_numbers
from conformance.control_session import ControlSession, ReceivedLine, connect_control, spawn_robot

# Clients read into buffers of 4096 bytes (Player, MATLAB's toolbox, UvA).
_MAX_LINE_BYTES = 4095
_OBSERVATION_S = 0.5
# A scanner that reports on demand takes one interval; intervals are tenths of seconds.
_SCAN_TIMEOUT_S = 2.0
_VECTORS = ("Location", "Orientation", "Pose")
_LINE = re.compile(r"[A-Z]+( \{[^{}]*\})*")
# UDK leaves out some spaces, and has an empty body behind a space.
_UDK_LINE = re.compile(r"[A-Z]+( ?\{[^{}]*\})* ?")
_EXPONENT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+|[-+]?(nan|inf|infinity)", re.IGNORECASE)
_QUERIES = tuple(
    f"GET{word} {{Type {type_}}}"
    for type_ in ("Robot", "RangeScanner", "Sonar", "Odometry", "GroundTruth")
    for word in ("CONF", "GEO")
)


def check_line_format(server: ServerUnderTest) -> None:
    """Each line ends with CR LF, has at most 4095 bytes and one space between its blocks."""
    for line in _observe_lines(server):
        excerpt = f"{line.data[:60]!r}...{line.data[-12:]!r}"
        if not line.data.endswith(b"\r\n"):
            raise CheckFailed(f"{excerpt}: expected CR LF at the end of the line")
        if len(line.data) > _MAX_LINE_BYTES:
            raise CheckFailed(f"{excerpt}: {len(line.data)} bytes, expected at most 4095")
        pattern = _UDK_LINE if server.dialect == "udk" else _LINE
        if not pattern.fullmatch(line.text):
            raise CheckFailed(f"{excerpt}: expected WORD {{Name Value}} {{Name Value}} ...")


def check_number_format(server: ServerUnderTest) -> None:
    """Numbers are plain decimals, and vectors have three of them."""
    for line in _observe_lines(server):
        for name, value in line.message.pairs:
            if name.lower() != "name" and any(map(_EXPONENT.fullmatch, re.split("[ ,]", value))):
                raise CheckFailed(f"{{{name} {value[:60]}}}: expected decimals without exponents")
            if line.message.word == "SEN" and name in _VECTORS:
                read_numbers(line.message, name, 3)
        if line.message.word in ("SEN", "STA") and line.message.get("Time") is not None:
            read_number(line.message, "Time")


def check_sensor_fields(server: ServerUnderTest) -> None:
    """Each SEN line has the blocks of its sensor in their order, one line for each list."""
    with spawn_robot(server) as session:
        session.read_next_cycle()
        lines = [line for line in session.lines if line.sensor_type]
    forms = READING_FORMS[server.dialect]
    for line in lines:
        if line.sensor_type == "camera" and server.dialect == "ut2004":
            raise CheckFailed(f"{line.text[:80]}: UT2004 has no SEN of a camera")
        form = forms.get(line.sensor_type, "SEN [{Time n}] {Type w}")
        if not matches_form(line.text.rstrip(), form, server.dialect):
            raise CheckFailed(f"{line.text[:120]}: expected {form}")
    for type_ in LISTED_TYPES[server.dialect]:
        _require_whole_lists(type_, [line for line in lines if line.sensor_type == type_])


def check_sensors_report(server: ServerUnderTest) -> None:
    """Each sensor that has a CONF reports, a range scanner at least after SET SCAN."""
    with spawn_robot(server) as session:
        session.read_next_cycle()
        for type_ in READING_FORMS[server.dialect]:
            conf = session.query(f"GETCONF {{Type {type_}}}")
            names = [name for one in conf if (name := one.get("Name"))]
            if names and not _has_report(session, type_, names[0]):
                raise CheckFailed(
                    f"CONF lists {', '.join(names)} of type {type_}: no SEN of this type within "
                    f"{_SCAN_TIMEOUT_S:g} s"
                )


def check_robot_configuration(server: ServerUnderTest) -> None:
    """CONF and GEO of the robot: all blocks in their order, positive mass, speed and sizes."""
    dialect = server.dialect
    with spawn_robot(server) as session:
        first = len(session.lines)
        session.query("GETCONF {Type Robot}", "GETGEO {Type Robot}")
        lines = {line.message.word: line for line in session.lines[first:]}
    for word, form, names in (
        ("CONF", CONFIGURATION_FORMS[dialect]["robot"], ("Mass", "MaxSpeed", "MaxTorque")),
        ("GEO", ROBOT_GEOMETRY_FORM, ("WheelRadius", "WheelSeparation", "WheelBase")),
    ):
        if word not in lines:
            raise CheckFailed(f"GET{word} {{Type Robot}}: no {word}")
        if not matches_form(lines[word].text, form, dialect):
            raise CheckFailed(f"{lines[word].text[:160]}: expected {form}")
        for name in names:
            if read_number(lines[word].message, name) <= 0.0:
                raise CheckFailed(f"{lines[word].text[:160]}: expected a positive {name}")


def check_sensor_configuration(server: ServerUnderTest) -> None:
    """CONF and GEO of every sensor that reports: all blocks in their order."""
    dialect = server.dialect
    with spawn_robot(server) as session:
        types = set(session.read_next_cycle()) & set(READING_FORMS[dialect])
        for type_ in sorted(types):
            first = len(session.lines)
            session.query(f"GETCONF {{Type {type_}}}", f"GETGEO {{Type {type_}}}")
            for word, form in (
                ("CONF", CONFIGURATION_FORMS[dialect].get(type_, "CONF {Type w} {Name w}")),
                ("GEO", PART_GEOMETRY_FORMS[dialect]),
            ):
                lines = [line for line in session.lines[first:] if line.message.word == word]
                if not lines:
                    raise CheckFailed(
                        f"GET{word} {{Type {type_}}}: no {word} of a sensor that reports"
                    )
                for line in lines:
                    if not matches_form(line.text, form, dialect):
                        raise CheckFailed(f"{line.text[:160]}: expected {form}")


def check_start_poses(server: ServerUnderTest) -> None:
    """GETSTARTPOSES: as many poses as it says, each a name and two vectors without spaces."""
    with connect_control(server) as session:
        session.query()
        lines = [line for line in session.lines if line.message.get("StartPoses") is not None]
    if not lines:
        raise CheckFailed("GETSTARTPOSES: no NFO {StartPoses n}")
    message = lines[0].message
    count = int(read_number(message, "StartPoses"))
    # `{A x,y,z r,p,y B x,y,z r,p,y}` of UvA and UDK, `{Name A Location x,y,z Orientation r,p,y}`
    # a block each of MOAST.
    words = " ".join(" ".join(pair) for pair in message.pairs[1:]).split()
    words = [word for word in words if word not in ("Name", "Location", "Orientation")]
    if len(words) != 3 * count:
        raise CheckFailed(
            f"{lines[0].text[:120]}: expected name x,y,z roll,pitch,yaw of {count} poses, observed "
            f"{len(words)} words"
        )
    for vector in (word for i, word in enumerate(words) if i % 3):
        read_numbers(Message("NFO", (("vector", vector),)), "vector", 3)


def _observe_lines(server: ServerUnderTest) -> list[ReceivedLine]:
    """Lines of every kind: greeting, readings, status, CONF, GEO and, in UT2004, RES."""
    with spawn_robot(server) as session:
        session.query(*_QUERIES, "SET {Type Odometry} {Name Odometry} {Opcode RESET}")
        session.send("DRIVE {Left 1.0} {Right 0.5}")
        session.read_for(_OBSERVATION_S)
        return session.lines


def _require_whole_lists(type_: str, lines: list[ReceivedLine]) -> None:
    """Fail where a line lists fewer sensors of a type than others together."""
    lists = [find_item_names(line.message) for line in lines]
    names = {name for one in lists for name in one}
    for one in lists:
        if set(one) != names:
            raise CheckFailed(
                f"a line of type {type_} lists {', '.join(one)}: expected one line with all "
                f"{len(names)} sensors"
            )


def _has_report(session: ControlSession, type_: str, name: str) -> bool:
    def has_line() -> bool:
        return any(line.sensor_type == type_ for line in session.lines)

    if not has_line():
        session.send(f"SET {{Type {type_}}} {{Name {name}}} {{Opcode SCAN}}")
    return session.read_until(has_line, _SCAN_TIMEOUT_S)


TEXT_CHECKS = (
    check_from_function("line_format", "control", check_line_format),
    check_from_function("number_format", "control", check_number_format),
    check_from_function("sensor_fields", "control", check_sensor_fields),
    check_from_function("sensors_report", "control", check_sensors_report),
    check_from_function("robot_configuration", "control", check_robot_configuration),
    check_from_function("sensor_configuration", "control", check_sensor_configuration),
    check_from_function("start_poses", "control", check_start_poses, needs_robot=False),
)
