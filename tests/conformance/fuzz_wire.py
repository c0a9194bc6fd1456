"""Does any parser fail on what a peer may send? Random and mutated bytes, a million cases.

Run: make fuzz, or, in tests/, `python -m conformance.fuzz_wire --cases 1000000 --seed 1`. A case is
one input to one parser. A parser may raise nothing but RemoteProtocolError, and only where its
docstring says so; it may keep no more than its limit. Prints a table; exits with 0 if all held.
"""

from __future__ import annotations

import argparse
import random
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.wire.commands import command_from_message, line_from_command
from catoptra_protocol.wire.connection import ControlClient, ControlServer
from catoptra_protocol.wire.dialect import Dialect
from catoptra_protocol.wire.envelope import MAX_ANSWER_BYTES, unpacked
from catoptra_protocol.wire.grammar import LineReader, parse_message
from catoptra_protocol.wire.image import ImageFrameReader, ImageRequestReader
from catoptra_protocol.wire.jpeg import jpeg_size
from catoptra_protocol.wire.limits import MAX_LINE_BYTES
from catoptra_protocol.wire.reports import Greeting, line_from_report, report_from_message

DATA = Path(__file__).parent / "data"
_FRAME_LIMIT_BYTES = 4096  # small, so that random lengths fall on both sides of it
_PROGRESS_EVERY = 50_000
_PIECES = (
    *(b"{", b"}", b" ", b",", b"\r", b"\n", b"\0", b"\xff", b"-", b".", b"1e308", b"-1e-308"),
    *(b"9" * 400, b"nan", b"inf", b"{Name ", b"{Type ", b"{Link ", b"{Location ", b"OK", b"U"),
)
# The start of a JPEG: APP0, quantisation, and the frame's 32 x 16 px.
_JPEG = bytes.fromhex("ffd8 ffe00004aabb ffdb0003 00 ffc00011 08 0010 0020 03011100021101031101")

Case = Callable[[bytes], bool]


@dataclass(slots=True)
class Parser:
    """One parser: how to feed it a case, what to mutate, and the tally."""

    name: str
    feed: Case  # returns whether the case was accepted; raises if the parser is broken
    seeds: tuple[bytes, ...]
    accepted: int = 0
    refused: int = 0
    seconds: float = 0.0


class BrokenError(Exception):
    """A parser kept more than its limit, or does not read what it wrote."""


def parsers() -> list[Parser]:
    """Return all parsers of the wire; those that keep something keep it from case to case."""
    commands, reports = _seeds("commands"), _seeds("reports")
    frames = (*_seeds("image_frames"), b"\2\0\0\0\4\xff\xd8\xff\xd9")
    return [
        Parser("LineReader", _line_reader(), commands),
        Parser("parse_message", _parse, (*commands, *reports)),
        Parser("command_from_message", _command, commands),
        Parser("report_from_message", _report, reports),
        Parser("ControlServer", _server(), commands),
        Parser("ControlClient", _client, reports),
        Parser("ImageRequestReader", _image_requests(), _seeds("image_requests")),
        Parser("ImageFrameReader", _image_frames, frames),
        Parser("jpeg_size", _jpeg, (_JPEG,)),
        Parser("envelope", _envelope, (b"\x81\xa4kind\xa4step", b"\x93\x01\xc0\xc4\x01a")),
    ]


def fuzz(them: Sequence[Parser], cases: int, seed: int, report: Callable[[int], None]) -> None:
    """Feed the parsers in turn. An error that is none of theirs carries the case."""
    chance = random.Random(seed)
    for number in range(cases):
        parser = them[number % len(them)]
        data = _mutated(chance, parser.seeds)
        begin_s = time.perf_counter()
        try:
            is_accepted = parser.feed(data)
        except Exception as error:
            raise BrokenError(f"{parser.name}, case {number}, {data!r}") from error
        parser.seconds += time.perf_counter() - begin_s
        parser.accepted += is_accepted
        parser.refused += not is_accepted
        if (number + 1) % _PROGRESS_EVERY == 0:
            report(number + 1)


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz and print; return the exit status."""
    options = argparse.ArgumentParser(description="Feed the wire's parsers with garbage.")
    options.add_argument("--cases", type=int, default=1_000_000)
    options.add_argument("--seed", type=int, default=1)
    given = options.parse_args(arguments)
    them, begin_s = parsers(), time.perf_counter()

    def progress(done: int) -> None:
        print(f"{done} cases, {time.perf_counter() - begin_s:.0f} s", flush=True)

    fuzz(them, given.cases, given.seed, progress)
    Console().print(table(them))
    print(f"{given.cases} cases, seed {given.seed}: no parser failed")
    return 0


def table(them: Sequence[Parser]) -> Table:
    """Return what became of the cases of each parser."""
    shown = Table("parser", "cases", "accepted", "refused", "us a case")
    for one in them:
        cases = one.accepted + one.refused
        microseconds = f"{1e6 * one.seconds / max(cases, 1):.1f}"
        shown.add_row(one.name, str(cases), str(one.accepted), str(one.refused), microseconds)
    return shown


def _mutated(chance: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Return a case: one in eight of random bytes, the others a seed with a few changes."""
    if chance.random() < 0.125:
        return chance.randbytes(chance.randrange(64))
    data = bytearray(chance.choice(seeds))
    for _ in range(chance.randrange(1, 5)):
        place = chance.randrange(len(data) + 1)
        match chance.randrange(5):
            case 0:
                data[place:place] = chance.choice(_PIECES)
            case 1:
                del data[place : place + chance.randrange(1, 12)]
            case 2:
                data[place : place + 1] = chance.randbytes(1)
            case 3:
                data += data[place : place + 40]
            case _:
                del data[place:]
    return bytes(data)


def _seeds(channel: str) -> tuple[bytes, ...]:
    """Return the vectors of a channel, long ones cut so that a case takes microseconds."""
    return tuple(path.read_bytes()[:600] for path in sorted((DATA / channel).glob("*.bytes")))


def _line_reader() -> Case:
    reader = LineReader()

    def feed(data: bytes) -> bool:
        lines = reader.receive(data)
        _hold(all(lines), "a blank line")
        _hold(len(reader._line) <= MAX_LINE_BYTES, "more than a line is kept")
        return bool(lines)

    return feed


def _parse(data: bytes) -> bool:
    text = data.decode("latin-1")
    message = parse_message(text)
    _hold(str(message).isprintable(), "a log line that cannot be printed")
    return bool(message.word)


def _command(data: bytes) -> bool:
    """Read a command of the first line; written and read again it is the same."""
    command = command_from_message(parse_message(_first_line(data)))
    if command is None:
        return False
    again = line_from_command(command).decode("latin-1")
    _hold(command_from_message(parse_message(again[:-2])) == command, "a command that changes")
    return True


def _report(data: bytes) -> bool:
    """Read a line of a server; what was read is written in both dialects, the same twice."""
    try:
        report = report_from_message(parse_message(_first_line(data)))
        if report is None:
            return False
        for dialect in Dialect:
            line_from_report(report, dialect)
        line = line_from_report(report)
        again = report_from_message(parse_message(line.decode("latin-1")[:-2]))
        _hold(again is not None and line_from_report(again) == line, "a report that changes")
    except (RemoteProtocolError, LocalProtocolError):
        return False  # malformed, or longer than a line that we would send
    return True


def _server() -> Case:
    server = ControlServer()
    server.send(Greeting("A", "B"))

    def feed(data: bytes) -> bool:
        for command in (commands := server.receive(data)):
            str(command)
        return bool(commands)

    return feed


def _client(data: bytes) -> bool:
    client = ControlClient()
    try:
        return bool(client.receive(data))
    except RemoteProtocolError:
        return False


def _image_requests() -> Case:
    reader = ImageRequestReader()

    def feed(data: bytes) -> bool:
        requests = reader.receive(data)
        _hold(len(reader._begun) <= 16, "more than a request is kept")
        return bool(requests)

    return feed


def _image_frames(data: bytes) -> bool:
    reader = ImageFrameReader(_FRAME_LIMIT_BYTES)
    try:
        frames = reader.receive(data)
    except RemoteProtocolError:
        return False
    _hold(len(reader._buffer) <= len(data), "more is kept than came")
    return bool(frames)


def _jpeg(data: bytes) -> bool:
    try:
        width, height = jpeg_size(data)
    except RemoteProtocolError:
        return False
    return width >= 0 and height >= 0


def _envelope(data: bytes) -> bool:
    try:
        return isinstance(unpacked(data, MAX_ANSWER_BYTES), dict)
    except RemoteProtocolError:
        return False


def _first_line(data: bytes) -> str:
    return data.replace(b"\n", b"\r").partition(b"\r")[0].decode("latin-1")


def _hold(is_so: bool, otherwise: str) -> None:
    if not is_so:
        raise BrokenError(otherwise)


if __name__ == "__main__":
    sys.exit(main())
