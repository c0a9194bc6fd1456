"""Fuzz targets of the control port and the image port, both directions; HTTP requests to them."""

from __future__ import annotations

from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.limits import MAX_LINE_BYTES
from catoptra_protocol.usarsim.commands import command_from_message, line_from_command
from catoptra_protocol.usarsim.control_connection import ControlClient, ControlServer
from catoptra_protocol.usarsim.grammar import Dialect, LineReader, parse_message
from catoptra_protocol.usarsim.image_port import (
    ImageFrameReader,
    ImageRequestReader,
    parse_jpeg_size,
    parse_raw_size,
)
from catoptra_protocol.usarsim.reports import Greeting, line_from_report, report_from_message
from catoptra_server.serve.tcp_server import TcpConnection
from conformance.fuzz_target import FeedInput, FuzzTarget, check, load_seed_corpus

# Small, so that random lengths fall on both sides.
_MAX_PAYLOAD_BYTES = 4096
# The start of a JPEG: APP0, quantisation, and the frame's 32 x 16 px.
_JPEG = bytes.fromhex("ffd8 ffe00004aabb ffdb0003 00 ffc00011 08 0010 0020 03011100021101031101")

# As a web page makes a browser send them: to other addresses, with a body of its choice.
_HTTP_HEAD = b"HTTP/1.1\r\nHost: 127.0.0.1:3000\r\nOrigin: http://x\r\nContent-Length: 40\r\n\r\n"
_HTTP_REQUESTS = (
    b"GET / HTTP/1.0\r\n\r\n",
    b"OPTIONS * " + _HTTP_HEAD,
    b"POST /x " + _HTTP_HEAD + b"INIT {ClassName USARBot.P2AT}\r\nDRIVE {Left 1.0}\r\n",
    b"PUT /" + b"x" * 99 + b" " + _HTTP_HEAD + b"OKU\0\0\0\0\0\0\0\0\0\0\0\1\0\0\0\1",
)


def usarsim_targets() -> list[FuzzTarget]:
    """The parsers."""
    commands, reports = load_seed_corpus("commands"), load_seed_corpus("reports")
    frames = (*load_seed_corpus("image_frames"), b"\2\0\0\0\4\xff\xd8\xff\xd9")
    return [
        FuzzTarget("LineReader", _make_line_reader_feeder(), commands),
        FuzzTarget("parse_message", _feed_message, (*commands, *reports)),
        FuzzTarget("command_from_message", _feed_command, commands),
        FuzzTarget("report_from_message", _feed_report, reports),
        FuzzTarget("ControlServer", _make_server_feeder(), commands),
        FuzzTarget("ControlClient", _feed_client, reports),
        FuzzTarget(
            "ImageRequestReader", _make_image_request_feeder(), load_seed_corpus("image_requests")
        ),
        FuzzTarget("HTTP to both ports", _make_http_feeder(), _HTTP_REQUESTS),
        FuzzTarget("ImageFrameReader", _feed_image_frames, frames),
        FuzzTarget("parse_jpeg_size", _feed_jpeg, (_JPEG,)),
        FuzzTarget("parse_raw_size", _feed_raw, (bytes.fromhex("0004 0002") + bytes(24),)),
    ]


def _make_line_reader_feeder() -> FeedInput:
    reader = LineReader()

    def feed(data: bytes) -> bool:
        lines = reader.receive(data)
        check(all(lines), "a blank line")
        check(len(reader._line) <= MAX_LINE_BYTES, "more than a line is buffered")
        return bool(lines)

    return feed


def _feed_message(data: bytes) -> bool:
    text = data.decode("latin-1")
    message = parse_message(text)
    check(str(message).isprintable(), "an unprintable log line")
    return bool(message.word)


def _feed_command(data: bytes) -> bool:
    """Parse a command; formatted and parsed again, the command must be the same."""
    command = command_from_message(parse_message(_first_line(data)))
    if command is None:
        return False
    again = line_from_command(command).decode("latin-1")
    check(command_from_message(parse_message(again[:-2])) == command, "a command that changes")
    return True


def _feed_report(data: bytes) -> bool:
    """Parse the first line of a server; its lines in both dialects must be stable."""
    try:
        report = report_from_message(parse_message(_first_line(data)))
        if report is None:
            return False
        for dialect in Dialect:
            line_from_report(report, dialect)
        line = line_from_report(report)
        if not line:  # an INIT at its very place succeeds without one
            return True
        again = report_from_message(parse_message(line.decode("latin-1")[:-2]))
        check(again is not None and line_from_report(again) == line, "a report that changes")
    except (RemoteProtocolError, LocalProtocolError):
        return False  # malformed, or longer than a line that we would send
    return True


def _make_server_feeder() -> FeedInput:
    server = ControlServer()
    server.send(Greeting("A", "B"))

    def feed(data: bytes) -> bool:
        for command in (commands := server.receive(data)):
            str(command)
        return bool(commands)

    return feed


def _feed_client(data: bytes) -> bool:
    client = ControlClient()
    try:
        return bool(client.receive(data))
    except RemoteProtocolError:
        return False


def _make_image_request_feeder() -> FeedInput:
    reader = ImageRequestReader()

    def feed(data: bytes) -> bool:
        requests = reader.receive(data)
        check(len(reader._pending) <= 16, "more than a request is buffered")
        return bool(requests)

    return feed


def _make_http_feeder() -> FeedInput:
    """Feeder of both ports' parsers, then of the check of a first line, in pieces."""
    parsers = _make_server_feeder(), _make_image_request_feeder()

    def feed(data: bytes) -> bool:
        for parser in parsers:
            parser(data)
        connection = TcpConnection("fuzz", on_lost=lambda _: None)
        for begin in range(0, len(data), 50):
            connection._ahead.append(data[begin : begin + 50])
            try:
                connection.read().send(None)
            except StopIteration:  # read, without a wait
                check(len(connection._first_line or b"") <= 64, "a long line is buffered")
            except ConnectionError:
                return False
        return True

    return feed


def _feed_image_frames(data: bytes) -> bool:
    reader = ImageFrameReader(_MAX_PAYLOAD_BYTES)
    try:
        frames = reader.receive(data)
    except RemoteProtocolError:
        return False
    check(len(reader._buffer) <= len(data), "more is buffered than was received")
    return bool(frames)


def _feed_jpeg(data: bytes) -> bool:
    try:
        width, height = parse_jpeg_size(data)
    except RemoteProtocolError:
        return False
    return width >= 0 and height >= 0


def _feed_raw(data: bytes) -> bool:
    try:
        width, height, pitch = parse_raw_size(data)
    except RemoteProtocolError:
        return False
    check(len(data) == 4 + height * pitch and pitch >= 3 * width, "a size that does not fit")
    return True


def _first_line(data: bytes) -> str:
    return data.replace(b"\n", b"\r").partition(b"\r")[0].decode("latin-1")
