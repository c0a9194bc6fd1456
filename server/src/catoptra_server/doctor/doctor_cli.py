"""`catoptra-server doctor`: examine this machine, print what was found, say it in the status."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence

from catoptra_protocol.errors import CatoptraError
from catoptra_server.config.bundled_files import bundled_files, find_configuration
from catoptra_server.doctor.finding import (
    Finding,
    Level,
    exit_status,
    fault,
    finding_from_dict,
)
from catoptra_server.doctor.installation import check_packages, check_python
from catoptra_server.doctor.ports import check_ports, check_running_server
from catoptra_server.doctor.processors import check_processors
from catoptra_server.doctor.renderer_devices import check_renderers
from catoptra_server.doctor.subprocess_check import run_in_subprocess

_EXIT_STATUS_HELP = (
    "status: 0 = all is well, 1 = it serves, with warnings, 2 = it cannot serve as asked"
)


def main(arguments: Sequence[str]) -> int:
    """Examine; return 0 = all is well, 1 = it serves, with warnings, 2 = it cannot serve."""
    parsed = _build_parser().parse_args(arguments)
    found = []
    for finding in _run_checks(parsed):
        found.append(finding)
        if not parsed.json:
            print(finding, flush=True)
    status = exit_status(found)
    if parsed.json:
        print(json.dumps({"status": status, "findings": [f.as_dict() for f in found]}, indent=2))
    else:
        print(_summarize(found))
    return status


def _summarize(findings: Sequence[Finding]) -> str:
    faults, warnings = (
        sum(finding.level is level for finding in findings)
        for level in (Level.FAULT, Level.WARNING)
    )
    can = "cannot serve as asked" if faults else "can serve"
    return f"catoptra-server {can} (faults: {faults}, warnings: {warnings})"


def _run_checks(parsed: argparse.Namespace) -> Iterator[Finding]:
    """Yield every finding as soon as it is made."""
    ports = {"control": parsed.control_port, "image": parsed.image_port}
    if parsed.answers is not None:
        yield from check_running_server(parsed.answers, ports)
        return
    yield from check_python()
    yield from check_packages()
    yield from check_processors()
    yield from check_renderers(parsed.renderer)
    yield from _check_configurations(parsed.robot, parsed.world)
    yield from check_ports(parsed.host, {**ports, "stream": parsed.stream_port})


def _check_configurations(robots: Sequence[str], worlds: Sequence[str]) -> Iterator[Finding]:
    """Yield how the given files do; those that come with the server, if none is given."""
    try:
        robot_files = [find_configuration("robots", text) for text in robots]
        world_files = [find_configuration("worlds", text) for text in worlds]
    except CatoptraError as error:
        yield fault("configurations", str(error), remedy="give the path of a file, or such a name")
        return
    if not robots and not worlds:
        robot_files, world_files = [*bundled_files("robots")], [*bundled_files("worlds")]
    words = map(str, (len(robot_files), *robot_files, *world_files))
    answer = run_in_subprocess("configurations", *words)
    if answer.error:
        remedy = "see the packages above"
        yield fault("configurations", f"cannot be read: {answer.error}", remedy=remedy)
    yield from map(finding_from_dict, answer.values.get("findings", ()))


def _build_parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="catoptra-server doctor",
        description="Say what this machine and these files can do, and what to do about the rest.",
        epilog=_EXIT_STATUS_HELP,
    )
    add = parser.add_argument
    add("--robot", action="append", default=[], metavar="FILE",
        help="robot ini or name; again for more (default: all that are shipped)")  # fmt: skip
    add("--world", action="append", default=[], metavar="FILE", help="world ini or name, likewise")
    add("--renderer", choices=["auto", "trace", "raster"], default="auto",
        help="what the server shall draw by; what it does not need is not tried")  # fmt: skip
    add("--host", default="127.0.0.1", help="address that the server shall listen on")
    add("--control-port", type=_parse_port, default=3000, metavar="PORT")
    add("--image-port", type=_parse_port, default=5003, metavar="PORT")
    add("--stream-port", type=_parse_port, default=5005, metavar="PORT")
    add("--answers", metavar="HOST", help="examine nothing: ask only whether a server runs there")
    add("--json", action="store_true", help="print one object for programs")
    return parser


def _parse_port(text: str) -> int:
    port = int(text)
    if not 0 <= port <= 65535:
        raise argparse.ArgumentTypeError(f"a port is 0 to 65535, not {port}")
    return port
