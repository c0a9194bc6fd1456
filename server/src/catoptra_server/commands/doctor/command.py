"""Command line of `catoptra-server doctor`: run the checks, print findings, set the exit status.

Checks are in `machine`, `devices` and `self_test`. To add one, write a function that yields
findings, and a line in `_run_checks`.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence

from catoptra_protocol.command_line import CommandParser, parse_port
from catoptra_protocol.errors import CatoptraError
from catoptra_server.commands.doctor.devices import check_renderers, run_in_subprocess
from catoptra_server.commands.doctor.machine import (
    Finding,
    Level,
    check_packages,
    check_ports,
    check_processors,
    check_python,
    check_running_server,
    check_system,
    check_view_port,
    exit_status,
    fault,
)
from catoptra_server.config.known_names import bundled_files, find_configuration
from catoptra_server.render.renderer_kind import AUTO, RENDERER_NAMES

_STREAM_PORT = 5005
_EXIT_STATUS_HELP = (
    "exit status: 0 = the server can start, perhaps with warnings, 1 = it cannot start or, with "
    "--probe, does not run"
)


def main(arguments: Sequence[str]) -> int:
    """Run the checks; a fault sets the exit status, as in the help text."""
    parsed = _build_parser().parse_args(arguments)
    findings = []
    # Printed one by one: a self-test takes seconds, and a check that hangs is the one after the
    # last line.
    for finding in _run_checks(parsed):
        findings.append(finding)
        if not parsed.json:
            print(finding, flush=True)
    status = exit_status(findings)
    if parsed.json:
        print(json.dumps({"status": status, "findings": [f.to_json() for f in findings]}, indent=2))
    else:
        print(_summarize(findings, parsed.probe))
    return status


def _summarize(findings: Sequence[Finding], probed: str | None) -> str:
    faults, warnings = (
        sum(finding.level is level for finding in findings)
        for level in (Level.FAULT, Level.WARNING)
    )
    if probed is not None:
        outcome = f"does not run on all these ports of {probed}" if faults else f"runs on {probed}"
    else:
        outcome = "cannot start with these options" if faults else "can start"
    return f"catoptra-server {outcome} (faults: {faults}, warnings: {warnings})"


def _run_checks(parsed: argparse.Namespace) -> Iterator[Finding]:
    """Yield findings in an order in which an early one explains the later ones."""
    ports = {"control": parsed.control_port, "image": parsed.image_port}
    # The containers' health check, every five seconds: two connections, and no library is loaded.
    if parsed.probe is not None:
        # These have other ports, or none, where the server's options say so.
        named = {"stream": parsed.stream_port, "live page": parsed.view_port}
        ports |= {name: port for name, port in named.items() if port is not None}
        yield from check_running_server(parsed.probe, ports)
        return
    yield from check_python()
    yield from check_system()
    yield from check_packages()
    yield from check_processors()
    yield from check_renderers(parsed.renderer)
    yield from _check_configurations(parsed.robot, parsed.world)
    stream_port = _STREAM_PORT if parsed.stream_port is None else parsed.stream_port
    yield from check_ports(parsed.host, {**ports, "stream": stream_port})
    yield from check_view_port(parsed.host, parsed.view_port)


def _check_configurations(robots: Sequence[str], worlds: Sequence[str]) -> Iterator[Finding]:
    """Yield the findings of the named files or, without names, of all bundled ones."""
    try:
        robot_files = [find_configuration("robots", text) for text in robots]
        world_files = [find_configuration("worlds", text) for text in worlds]
    except CatoptraError as error:
        yield fault(
            "configurations", str(error), remedy="give the path of a file, or one of these names"
        )
        return
    if not robots and not worlds:
        robot_files, world_files = [*bundled_files("robots")], [*bundled_files("worlds")]
    # In a process of its own, since meshes and textures load trimesh and Pillow.
    arguments = map(str, (len(robot_files), *robot_files, *world_files))
    try:
        yield from map(
            Finding.from_json, run_in_subprocess("configurations", *arguments)["findings"]
        )
    except CatoptraError as error:
        remedy = "see the packages above"
        yield fault("configurations", f"cannot be read: {error}", remedy=remedy)


def _build_parser() -> CommandParser:
    parser = CommandParser(
        "catoptra-server doctor",
        "Check whether the server can run on this machine with these files.",
        epilog=_EXIT_STATUS_HELP,
    )
    add = parser.add_argument
    add("--robot", action="append", default=[], metavar="FILE",
        help="robot ini or name; again for more (default: all bundled ones)")  # fmt: skip
    add("--world", action="append", default=[], metavar="FILE",
        help="world ini or name, likewise (default: all bundled ones)")  # fmt: skip
    add("--renderer", choices=RENDERER_NAMES, default=AUTO,
        help="renderer of the server; the other one is not checked")  # fmt: skip
    add("--host", default="127.0.0.1", help="address on which the server will listen")
    add("--control-port", type=parse_port, default=3000, metavar="PORT", help="control port")
    add("--image-port", type=parse_port, default=5003, metavar="PORT", help="image port")
    add("--stream-port", type=parse_port, metavar="PORT",
        help=f"ZeroMQ stream (default: {_STREAM_PORT}; with --probe only if given)")  # fmt: skip
    add("--view", dest="view_port", type=parse_port, metavar="PORT",
        help="port of the live page (default: 5080, or a free one; with --probe only if "
        "given)")  # fmt: skip
    add("--probe", metavar="HOST", help="check only whether a server runs there, on these ports")
    add("--json", action="store_true", help="print one JSON object instead of lines")
    return parser
