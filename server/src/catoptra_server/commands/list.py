"""`catoptra-server list`: bundled files by kind, and the classes that INIT can name.

Robots, worlds, landmarks and recipes of data sets are described by the first sentence of the
comment that heads their file, cameras by title and source, classes by what would be built.
`catoptra-server --version` prints one line: version, system and the kernel's instruction set.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

from catoptra_protocol import command_line
from catoptra_protocol.command_line import CommandParser
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.config.camera_file import CameraFile, read_camera_files
from catoptra_server.config.known_names import bundled_files
from catoptra_server.config.robot_file import read_robots
from catoptra_server.render.trace.kernel.library import (
    KernelDevice,
    KernelUnavailableError,
    choose_instruction_set,
)
from catoptra_server.simulation.robot_description import RobotDescription

_KINDS = ("robots", "worlds", "cameras", "landmarks", "datasets", "classes")
# The comment at the head of an ini or csv file.
_COMMENT = re.compile(r"(?:[;#].*\n?)+")
_SENTENCE = re.compile(r"(.*?\.)(?:\s|$)")


@dataclass(frozen=True, slots=True)
class _ListEntry:
    """One name that a command or a client's INIT accepts."""

    kind: str
    """One of `_KINDS`."""
    name: str
    description: str
    path: str
    """File that describes the name."""

    def __str__(self) -> str:
        return f"  {self.name}\n      {self.description}\n      {self.path}"


def main(arguments: Sequence[str]) -> int:
    """Print the names of one kind or of all; the exit status is 0."""
    parser = CommandParser(
        "catoptra-server list",
        "List the bundled robots, worlds, landmarks and recipes, whose names --robot, "
        "--world, --landmarks and `dataset` take, cameras for robots and studies, and the classes "
        "that INIT can spawn from each robot file.",
    )
    parser.add_argument(
        "kind", nargs="?", choices=_KINDS, metavar="|".join(_KINDS), help="(default: all)"
    )
    parser.add_argument("--json", action="store_true", help="print a JSON list")
    parsed = parser.parse_args(arguments)
    entries = list(_list_entries([parsed.kind] if parsed.kind else _KINDS))
    if parsed.json:
        print(json.dumps([asdict(entry) for entry in entries], indent=2))
    else:
        _print_entries(entries)
    return 0


def _print_entries(entries: Sequence[_ListEntry]) -> None:
    """Print entries, with a heading for each kind."""
    kind = ""
    for entry in entries:
        if entry.kind != kind:
            kind = entry.kind
            print(f"{kind}:")
        print(entry)


def _list_entries(kinds: Sequence[str]) -> Iterator[_ListEntry]:
    """Yield the entries of each kind, sorted by name."""
    for kind in kinds:
        match kind:
            case "robots" | "worlds" | "datasets" | "landmarks":
                yield from (_describe_file(kind, path) for path in bundled_files(kind))
            case "cameras":
                yield from map(_describe_camera, read_camera_files(()))
            case _:
                yield from sorted(_list_classes(), key=lambda entry: (entry.name, entry.path))


def _describe_file(kind: str, path: Path) -> _ListEntry:
    return _ListEntry(kind, path.stem, _read_first_sentence(path), str(path))


def _read_first_sentence(path: Path) -> str:
    """First sentence of the comment at the head of a file; empty without one."""
    comment = _COMMENT.match(path.read_text(encoding="utf-8"))
    words = re.sub(r"\s*\n[;#]?\s*", " ", comment[0]).lstrip(";# ").strip() if comment else ""
    sentence = _SENTENCE.match(words)
    return sentence[1] if sentence else words


def _describe_camera(file: CameraFile) -> _ListEntry:
    return _ListEntry("cameras", file.name, f"{file.title}. {file.source}", str(file.path))


def _list_classes() -> Iterator[_ListEntry]:
    for path in bundled_files("robots"):
        robots, _ = read_robots(path)
        for robot in robots:
            yield _ListEntry(
                "classes",
                robot.class_name,
                f"--robot {path.stem}: {_describe_equipment(robot)}",
                str(path),
            )


def _describe_equipment(robot: RobotDescription) -> str:
    """Cameras with their sizes, and sensors by kind with their number."""
    cameras = [
        f"camera {camera.name} {camera.width_px} x {camera.height_px} px"
        for camera in robot.perspective_cameras
    ]
    cameras[:0] = [
        f"{'mirror' if omni.camera.has_mirror else 'wide-angle'} camera {omni.name} "
        f"{omni.camera.width_px} x {omni.camera.height_px} px"
        for omni in robot.omni_cameras
    ]
    kinds = Counter(type(sensor).__name__.removesuffix("Description") for sensor in robot.sensors)
    sensors = [kind if number == 1 else f"{number} {kind}" for kind, number in kinds.items()]
    return ", ".join((*(cameras or ["no camera"]), *(sensors or ["no sensor"])))


def describe_version(distribution: str = "catoptra-server") -> str:
    """Version of the server, Python, system, and the instruction set, or why there is no kernel."""
    return f"{command_line.describe_version(distribution)[:-1]}; {_describe_kernel()})"


def _describe_kernel() -> str:
    try:
        instruction_set = choose_instruction_set()
        # Opened, since a library that is there may not load.
        KernelDevice(instruction_set, 1).close()
    except KernelUnavailableError as error:
        return str(error)
    return f"kernel: {instruction_set}"
