"""`catoptra-server doctor`: examine this machine, print what was found, say it in the status."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence

from catoptra_protocol.errors import CatoptraError
from catoptra_server.config.shipped import configuration_file, shipped_files
from catoptra_server.doctor.children import ask
from catoptra_server.doctor.finding import (
    Finding,
    Level,
    exit_status,
    fault,
    finding_from_dict,
)
from catoptra_server.doctor.installation import package_findings, python_findings
from catoptra_server.doctor.ports import answer_findings, port_findings
from catoptra_server.doctor.processor import processor_findings
from catoptra_server.doctor.renderers import renderer_findings

_STATUS = "status: 0 = all is well, 1 = it serves, with warnings, 2 = it cannot serve as asked"


def main(arguments: Sequence[str]) -> int:
    """Examine; return 0 = all is well, 1 = it serves, with warnings, 2 = it cannot serve."""
    parsed = _parser().parse_args(arguments)
    found = []
    for finding in _findings(parsed):
        found.append(finding)
        if not parsed.json:
            print(finding, flush=True)
    status = exit_status(found)
    if parsed.json:
        print(json.dumps({"status": status, "findings": [f.as_dict() for f in found]}, indent=2))
    else:
        print(_verdict(found))
    return status


def _verdict(found: Sequence[Finding]) -> str:
    faults, warnings = (
        sum(finding.level is level for finding in found) for level in (Level.FAULT, Level.WARNING)
    )
    can = "cannot serve as asked" if faults else "can serve"
    return f"catoptra-server {can} (faults: {faults}, warnings: {warnings})"


def _findings(parsed: argparse.Namespace) -> Iterator[Finding]:
    """Yield every finding as soon as it is made."""
    ports = {"control": parsed.control_port, "image": parsed.image_port}
    if parsed.answers is not None:
        yield from answer_findings(parsed.answers, ports)
        return
    yield from python_findings()
    yield from package_findings()
    yield from processor_findings()
    yield from renderer_findings(parsed.renderer)
    yield from _configurations(parsed.robot, parsed.world)
    yield from port_findings(parsed.host, {**ports, "stream": parsed.stream_port})


def _configurations(robots: Sequence[str], worlds: Sequence[str]) -> Iterator[Finding]:
    """Yield how the given files do; those that come with the server, if none is given."""
    try:
        robot_files = [configuration_file("robots", text) for text in robots]
        world_files = [configuration_file("worlds", text) for text in worlds]
    except CatoptraError as error:
        yield fault("configurations", str(error), remedy="give the path of a file, or such a name")
        return
    if not robots and not worlds:
        robot_files, world_files = [*shipped_files("robots")], [*shipped_files("worlds")]
    words = map(str, (len(robot_files), *robot_files, *world_files))
    answer = ask("configurations", *words)
    if answer.trouble:
        remedy = "see the packages above"
        yield fault("configurations", f"cannot be read: {answer.trouble}", remedy=remedy)
    yield from map(finding_from_dict, answer.facts.get("findings", ()))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="catoptra-server doctor",
        description="Say what this machine and these files can do, and what to do about the rest.",
        epilog=_STATUS,
    )
    add = parser.add_argument
    add("--robot", action="append", default=[], metavar="FILE",
        help="robot ini or name; again for more (default: all that are shipped)")  # fmt: skip
    add("--world", action="append", default=[], metavar="FILE", help="world ini or name, likewise")
    add("--renderer", choices=["auto", "trace", "raster"], default="auto",
        help="what the server shall draw by; what it does not need is not tried")  # fmt: skip
    add("--host", default="127.0.0.1", help="address that the server shall listen on")
    add("--control-port", type=_port, default=3000, metavar="PORT")
    add("--image-port", type=_port, default=5003, metavar="PORT")
    add("--stream-port", type=_port, default=5005, metavar="PORT")
    add("--answers", metavar="HOST", help="examine nothing: ask only whether a server runs there")
    add("--json", action="store_true", help="print one object for programs")
    return parser


def _port(text: str) -> int:
    port = int(text)
    if not 0 <= port <= 65535:
        raise argparse.ArgumentTypeError(f"a port is 0 to 65535, not {port}")
    return port
