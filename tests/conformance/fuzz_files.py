"""Fuzz targets of files: Unreal's ini grammar, robots, worlds and landmarks.

Files are no input of an attacker, but every fault must be reported with its line: a parser may
raise ConfigError only.
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
    parse_struct,
    strip_comment,
    unquote,
)
from catoptra_server.config.world_file import read_world
from conformance.fuzz_target import FeedInput, FuzzTarget, check
from helpers.configs import REPOSITORY, ROBOTS, WORLDS

# A robot file takes milliseconds, other inputs microseconds.
_FILE_PERIOD = 20
_STRUCTS = (
    b"(ItemClass=class'USARSensor.SICK',ItemName=\"lms200\",Position=(X=0.2,Y=0.0,Z=-0.2))",
    b'(A=1,B=(X=0,Y=(Z="(")),C=)\'was y=-1.2',
)
_LINES = b'[A.B]\r\nkey = value ; comment\n+list=1\n-list="a;b"\n!x=\n[c]\n.y=(A=1)\n'


def file_targets() -> list[FuzzTarget]:
    """The parsers."""
    robots = tuple(path.read_bytes() for path in sorted(ROBOTS.glob("*.ini")))
    worlds = tuple(path.read_bytes() for path in sorted(WORLDS.glob("*.ini")))
    landmarks = REPOSITORY / "configs/landmarks/four_legged_2006.csv"
    return [
        FuzzTarget("parse_sections", _feed_sections, (_LINES, robots[0][:600])),
        FuzzTarget("parse_struct", _feed_struct, _STRUCTS),
        FuzzTarget("landmarks", _feed_landmarks, (landmarks.read_bytes(),)),
        FuzzTarget(
            "robot file", _make_file_feeder(ROBOTS, read_robots), robots, period=_FILE_PERIOD
        ),
        FuzzTarget(
            "world file", _make_file_feeder(WORLDS, read_world), worlds, period=_FILE_PERIOD
        ),
    ]


def _feed_sections(data: bytes) -> bool:
    try:
        sections = parse_sections(data.decode("latin-1"), file="fuzz.ini")
    except ConfigError:
        return False
    entries = (entry for section in sections for entry in section.entries)
    check(all(entry.key and entry.where.line for entry in entries), "an entry without key or line")
    return True


def _feed_struct(data: bytes) -> bool:
    text = data.decode("latin-1")
    check(text.startswith(strip_comment(text)), "a comment that changes the text before it")
    members = parse_struct(text)
    for name, value in members or ():
        check(bool(name) and value in text, "a member that is not in the text")
        parse_struct(value)
        unquote(value)
    return members is not None


def _feed_landmarks(data: bytes) -> bool:
    lines = data.decode("latin-1").split("\n")
    try:
        landmarks = landmarks_from_lines(lines, file="fuzz.csv")
    except ConfigError:
        return False
    check(all(abs(mark.x_m) <= 1e5 for mark in landmarks), "a landmark beyond the horizon")
    return True


def _make_file_feeder(folder: Path, read: Callable[[Path], object]) -> FeedInput:
    """Feeder that writes each input beside the files of a folder, for its references to them."""
    directory = tempfile.TemporaryDirectory(prefix="fuzz")
    atexit.register(directory.cleanup)
    scratch = Path(directory.name)
    for path in (*folder.parent.iterdir(), *folder.iterdir()):
        copy = scratch / path.relative_to(folder.parent)
        if path == folder:
            copy.mkdir()
        else:
            copy.symlink_to(path)
    file = scratch / folder.name / "fuzzed"

    def feed(data: bytes) -> bool:
        file.write_bytes(data)
        try:
            read(file)
        except ConfigError:
            return False
        return True

    return feed
