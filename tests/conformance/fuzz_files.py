"""The parsers of files: Unreal's ini grammar, robots, worlds and landmarks.

A file is not sent by a stranger, but what is wrong with it must be said with its line, not with a
traceback: nothing but ConfigError may come out.
"""

from __future__ import annotations

import atexit
import tempfile
from collections.abc import Callable
from pathlib import Path

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.landmarks import landmarks_from_lines
from catoptra_server.config.robot_file import read_robots
from catoptra_server.config.unreal_ini import (
    parse_sections,
    plain_text,
    struct_members,
    without_comment,
)
from catoptra_server.config.world_file import read_world
from conformance.fuzz_parser import Case, Parser, hold
from helpers.configs import REPOSITORY, ROBOTS, WORLDS

# A whole robot file takes milliseconds, so it has one case in so many.
_EVERY = 10
_STRUCTS = (
    b"(ItemClass=class'USARSensor.SICK',ItemName=\"lms200\",Position=(X=0.2,Y=0.0,Z=-0.2))",
    b'(A=1,B=(X=0,Y=(Z="(")),C=)\'was y=-1.2',
)
_LINES = b'[A.B]\r\nkey = value ; comment\n+list=1\n-list="a;b"\n!x=\n[c]\n.y=(A=1)\n'


def parsers() -> list[Parser]:
    """Return the parsers."""
    robots = tuple(path.read_bytes() for path in sorted(ROBOTS.glob("*.ini")))
    worlds = tuple(path.read_bytes() for path in sorted(WORLDS.glob("*.ini")))
    landmarks = REPOSITORY / "configs/landmarks/four_legged_2006.csv"
    return [
        Parser("parse_sections", _sections, (_LINES, robots[0][:600])),
        Parser("struct_members", _struct, _STRUCTS),
        Parser("landmarks", _landmarks, (landmarks.read_bytes(),)),
        Parser("robot file", _file(ROBOTS, read_robots), robots, every=_EVERY),
        Parser("world file", _file(WORLDS, read_world), worlds, every=_EVERY),
    ]


def _sections(data: bytes) -> bool:
    try:
        sections = parse_sections(data.decode("latin-1"), file="fuzz.ini")
    except ConfigError:
        return False
    entries = (entry for section in sections for entry in section.entries)
    hold(all(entry.key and entry.where.line for entry in entries), "an entry without key or line")
    return True


def _struct(data: bytes) -> bool:
    text = data.decode("latin-1")
    hold(text.startswith(without_comment(text)), "a comment that changes what is before it")
    members = struct_members(text)
    for name, value in members or ():
        hold(bool(name) and value in text, "a member that is not there")
        struct_members(value)
        plain_text(value)
    return members is not None


def _landmarks(data: bytes) -> bool:
    lines = data.decode("latin-1").split("\n")
    try:
        landmarks = landmarks_from_lines(lines, file="fuzz.csv")
    except ConfigError:
        return False
    hold(all(abs(mark.x_m) <= 1e5 for mark in landmarks), "a landmark beyond the horizon")
    return True


def _file(folder: Path, read: Callable[[Path], object]) -> Case:
    """Return a case that writes a file, as a neighbour of what the folder's own files name."""
    kept = tempfile.TemporaryDirectory(prefix="fuzz")
    atexit.register(kept.cleanup)
    scratch = Path(kept.name)
    for path in (*folder.parent.iterdir(), *folder.iterdir()):
        place = scratch / path.relative_to(folder.parent)
        if path == folder:
            place.mkdir()
        else:
            place.symlink_to(path)
    file = scratch / folder.name / "fuzzed"

    def feed(data: bytes) -> bool:
        file.write_bytes(data)
        try:
            read(file)
        except ConfigError:
            return False
        return True

    return feed
