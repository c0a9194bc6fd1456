"""Conformance test of a live server, ours or another's: conversations and checks by physics.

Run: make conformance ADDRESS=host:port [IMAGE=host:port] [STREAM=host:port] [PAGE=host:port]
[DIALECT=udk] [LEGACY=yes], or, in tests/, `python -m conformance.play host:port`. The conversations
are the files of data/conversations, the checks those of suite.py; rows for ports without an
address, or for servers of another kind, are left out. The server's clock must be realtime. Prints a
table; exits with 0 if every required row passes or is skipped with a reason, with 1 if one fails,
with 2 without a server.
"""

from __future__ import annotations

import argparse
import dataclasses
import socket
import sys
from collections import Counter
from collections.abc import Sequence
from fnmatch import fnmatchcase

from rich.console import Console
from rich.table import Table

from conformance.check import ServerUnderTest
from conformance.class_survey import choose_classes, find_start_pose
from conformance.control_session import REPORT_TIMEOUT_S, connect_control
from conformance.conversation_file import Address
from conformance.suite import PLAYERS, Outcome, RowResult, applicable_checks, play_checks

# As shells report a process that SIGINT ended.
EXIT_INTERRUPTED = 130
_STYLES = {
    Outcome.PASSED: "green",
    Outcome.FAILED: "red",
    Outcome.SKIPPED: "yellow",
    Outcome.NOT_REQUIRED: "yellow",
}


def play_suite(
    server: ServerUnderTest, camera_class: str, patterns: Sequence[str]
) -> list[RowResult]:
    """Results of the rows for a server.

    Args:
        server: Server, with the class of the rows of the control port.
        camera_class: Class of the rows of image port and stream.
        patterns: Names of rows, with `*` and `?`.
    """
    checks = [
        check
        for check in applicable_checks(server)
        if any(fnmatchcase(check.name, pattern) for pattern in patterns)
    ]
    control = [check for check in checks if check.port == "control"]
    pictures = [check for check in checks if check.port != "control"]
    camera_server = dataclasses.replace(server, robot_class=camera_class)
    return [*play_checks(control, server), *play_checks(pictures, camera_server)]


def results_table(results: Sequence[RowResult]) -> Table:
    """Table of results by port."""
    table = Table("port", "row", "description", "result")
    for port in PLAYERS:
        for result in (one for one in results if one.check.port == port):
            text = result.outcome.value + (f": {result.reason}" if result.reason else "")
            outcome = f"[{_STYLES[result.outcome]}]{_escape_markup(text)}"
            table.add_row(
                port, result.check.name, _escape_markup(result.check.description), outcome
            )
        table.add_section()
    return table


def summarize(results: Sequence[RowResult]) -> str:
    """Number of rows by outcome."""
    counts = Counter(result.outcome for result in results)
    parts = ", ".join(f"{counts[outcome]} {outcome.value}" for outcome in Outcome)
    return f"{len(results)} rows: {parts}"


def find_missing_server(addresses: dict[str, Address]) -> str:
    """Reason why a port cannot be reached; empty if all can."""
    for port, address in addresses.items():
        try:
            socket.create_connection(address, timeout=REPORT_TIMEOUT_S).close()
        except OSError as error:
            host, number = address
            return f"no server at {host}:{number} ({port} port): {error.strerror or error}"
    return ""


def main(arguments: Sequence[str] | None = None) -> int:
    """Play all applicable rows; exit status."""
    options = _parse_arguments(arguments)
    ports = {port: getattr(options, port) for port in PLAYERS}
    addresses = {port: address for port, address in ports.items() if address}
    if reason := find_missing_server(addresses):
        print(reason, file=sys.stderr)
        return 2
    server = ServerUnderTest(
        addresses,
        options.robot_class or "",
        options.spawn_pose or "",
        options.dialect,
        options.legacy_images,
    )
    results = _survey_and_play(server, options.rows or ["*"])
    Console().print(results_table(results))
    print(summarize(results))
    # No row at all is a failure, too: a wrong option would pass otherwise.
    failed = any(result.outcome is Outcome.FAILED for result in results)
    return 1 if failed or not results else 0


def _survey_and_play(server: ServerUnderTest, patterns: Sequence[str]) -> list[RowResult]:
    """Results with the class and pose of the options, or else those that the server has."""
    try:
        server = dataclasses.replace(server, is_recording=_is_recording(server))
        pose = server.spawn_pose or find_start_pose(server)
        server = dataclasses.replace(server, spawn_pose=pose)
        classes = (server.robot_class, server.robot_class)
        control_class, camera_class = classes if server.robot_class else choose_classes(server)
    except OSError:
        # A server that ends now: each row states that.
        control_class = camera_class = server.robot_class
    print(f"robot class {control_class}, of pictures {camera_class}; {server.spawn_pose}")
    server = dataclasses.replace(server, robot_class=control_class)
    return play_suite(server, camera_class, patterns)


def _is_recording(server: ServerUnderTest) -> bool:
    """Whether the greeting is that of a recording."""
    with connect_control(server) as session:
        session.read_until(lambda: bool(session.lines), REPORT_TIMEOUT_S)
        return any(line.message.get("Gametype") == "Recording" for line in session.lines)


def _parse_arguments(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Test the conformance of a live server.")
    parser.add_argument("control", type=_parse_address, help="host:port of the control server")
    parser.add_argument("--image", type=_parse_address, help="host:port of the image server")
    parser.add_argument("--stream", type=_parse_address, help="host:port of the ZeroMQ stream")
    parser.add_argument("--page", type=_parse_address, help="host:port of the live page")
    parser.add_argument("--dialect", choices=("ut2004", "udk"), default="ut2004")
    parser.add_argument(
        "--legacy-images", action="store_true", help="server sends an unsolicited frame"
    )
    parser.add_argument(
        "--robot-class", help="default: of the known classes those with most sensors and cameras"
    )
    parser.add_argument(
        "--rows", nargs="+", metavar="NAME", help="only these rows; patterns such as 'drive_*'"
    )
    parser.add_argument(
        "--spawn-pose", help="blocks of INIT, {Location 1,2,0}; default: a start pose"
    )
    return parser.parse_args(arguments)


def _parse_address(text: str) -> Address:
    host, _, port = text.rpartition(":")
    try:
        return host or "127.0.0.1", int(port)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: expected host:port") from error


def _escape_markup(text: str) -> str:
    """Text without markup for rich."""
    return text.replace("[", r"\[")


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(EXIT_INTERRUPTED)
