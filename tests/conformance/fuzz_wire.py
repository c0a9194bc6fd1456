"""The parsers of the two old ports, both directions."""

from __future__ import annotations

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.wire.commands import command_from_message, line_from_command
from catoptra_protocol.wire.connection import ControlClient, ControlServer
from catoptra_protocol.wire.dialect import Dialect
from catoptra_protocol.wire.grammar import LineReader, parse_message
from catoptra_protocol.wire.image import ImageFrameReader, ImageRequestReader, raw_size
from catoptra_protocol.wire.jpeg import jpeg_size
from catoptra_protocol.wire.limits import MAX_LINE_BYTES
from catoptra_protocol.wire.reports import Greeting, line_from_report, report_from_message
from conformance.fuzz_parser import Case, Parser, hold, seeds

_FRAME_LIMIT_BYTES = 4096  # small, so that random lengths fall on both sides of it
# The start of a JPEG: APP0, quantisation, and the frame's 32 x 16 px.
_JPEG = bytes.fromhex("ffd8 ffe00004aabb ffdb0003 00 ffc00011 08 0010 0020 03011100021101031101")


def parsers() -> list[Parser]:
    """Return the parsers; those that keep something keep it from case to case."""
    commands, reports = seeds("commands"), seeds("reports")
    frames = (*seeds("image_frames"), b"\2\0\0\0\4\xff\xd8\xff\xd9")
    return [
        Parser("LineReader", _line_reader(), commands),
        Parser("parse_message", _parse, (*commands, *reports)),
        Parser("command_from_message", _command, commands),
        Parser("report_from_message", _report, reports),
        Parser("ControlServer", _server(), commands),
        Parser("ControlClient", _client, reports),
        Parser("ImageRequestReader", _image_requests(), seeds("image_requests")),
        Parser("ImageFrameReader", _image_frames, frames),
        Parser("jpeg_size", _jpeg, (_JPEG,)),
        Parser("raw_size", _raw, (bytes.fromhex("0004 0002") + bytes(24),)),
    ]


def _line_reader() -> Case:
    reader = LineReader()

    def feed(data: bytes) -> bool:
        lines = reader.receive(data)
        hold(all(lines), "a blank line")
        hold(len(reader._line) <= MAX_LINE_BYTES, "more than a line is kept")
        return bool(lines)

    return feed


def _parse(data: bytes) -> bool:
    text = data.decode("latin-1")
    message = parse_message(text)
    hold(str(message).isprintable(), "a log line that cannot be printed")
    return bool(message.word)


def _command(data: bytes) -> bool:
    """Read a command of the first line; written and read again it is the same."""
    command = command_from_message(parse_message(_first_line(data)))
    if command is None:
        return False
    again = line_from_command(command).decode("latin-1")
    hold(command_from_message(parse_message(again[:-2])) == command, "a command that changes")
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
        hold(again is not None and line_from_report(again) == line, "a report that changes")
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
        hold(len(reader._begun) <= 16, "more than a request is kept")
        return bool(requests)

    return feed


def _image_frames(data: bytes) -> bool:
    reader = ImageFrameReader(_FRAME_LIMIT_BYTES)
    try:
        frames = reader.receive(data)
    except RemoteProtocolError:
        return False
    hold(len(reader._buffer) <= len(data), "more is kept than came")
    return bool(frames)


def _jpeg(data: bytes) -> bool:
    try:
        width, height = jpeg_size(data)
    except RemoteProtocolError:
        return False
    return width >= 0 and height >= 0


def _raw(data: bytes) -> bool:
    try:
        width, height, pitch = raw_size(data)
    except RemoteProtocolError:
        return False
    hold(len(data) == 4 + height * pitch and pitch >= 3 * width, "a size that does not fit")
    return True


def _first_line(data: bytes) -> str:
    return data.replace(b"\n", b"\r").partition(b"\r")[0].decode("latin-1")
