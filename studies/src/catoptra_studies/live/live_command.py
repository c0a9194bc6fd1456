"""The command `catoptra-studies live`: a server in real time, and a robot to watch in the page."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from types import FrameType

from catoptra_client.control_connection import ServerAddress
from catoptra_client.server_process import start_server
from catoptra_protocol.command_line import CommandParser, parse_count, parse_integer, parse_port
from catoptra_protocol.errors import CatoptraError
from catoptra_studies.commands import add_output, make_parser, parse_study, print_line
from catoptra_studies.live.live_drive import open_live_drive

# A shell's status of a process that a signal ends is 128 and the signal's number: 130 for Ctrl-C.
_EXIT_SIGNAL = 128

_DEFAULT_VIEW_PORT = 5080
# The server prints the link with the address.
_PAGE_TIMEOUT_S = 10.0
_TEXT = """\
A robot drives the paper's route and localizes itself by landmarks; Ctrl-C ends it.
Programs reach its server on ports {control} (control), {image} (images), {stream} (stream).
To try: drive the robot by the arrow keys; it returns to its route 3 s after the last one.
        move the slider of accuracy, or force an effect: the page shows what changes, and its cost.
Watch it at {link}"""


def main(arguments: Sequence[str]) -> int:
    """Run server and robot until a signal, the last lap or an error.

    Returns:
        0 after `--laps`, 130 after Ctrl-C, 1 after an error.
    """
    parsed = parse_study(_make_parser(), arguments)
    try:
        with _raise_on_signals():
            return _run(parsed)
    except KeyboardInterrupt as interrupt:
        print_line("live: server and robot have ended")
        number = interrupt.args[0] if interrupt.args else signal.SIGINT
        return _EXIT_SIGNAL + int(number)


def _run(parsed: argparse.Namespace) -> int:
    # The server's usual ports, for other programs; port 0 takes free ones throughout.
    ports = ("--control-port", "0", "--image-port", "0") if parsed.view == 0 else ()
    server_arguments = (
        *("--robot", parsed.robot, "--world", parsed.world, "--seed", str(parsed.seed)),
        *("--view", str(parsed.view), *ports),
    )
    links = SimpleQueue[str]()
    log_file = parsed.out / "server.log"
    with start_server(server_arguments, log_file=log_file, on_page=links.put) as address:
        # At once: the page is open before the training ends.
        _print_address(address, links)
        with open_live_drive(address) as drive:
            drive.run(parsed.laps)
    return 0


def _print_address(address: ServerAddress, links: SimpleQueue[str]) -> None:
    try:
        link = links.get(timeout=_PAGE_TIMEOUT_S)
    except Empty as error:
        raise CatoptraError("the server serves no live page: see its log") from error
    control, image, stream = address.control_port, address.image_port, address.stream_port
    print_line(_TEXT.format(control=control, image=image, stream=stream, link=link))


@contextmanager
def _raise_on_signals() -> Iterator[None]:
    """End by KeyboardInterrupt on SIGTERM and SIGHUP, too: the server must not stay behind."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt(number)

    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    previous = [signal.signal(number, interrupt) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, previous, strict=True):
            signal.signal(number, handler)


def _make_parser() -> CommandParser:
    parser = make_parser(
        "live",
        "Start a server in real time with a robot that drives the paper's route and "
        "localizes itself, and print the link of the page that shows it.",
    )
    add = parser.add_argument
    add("--robot", default="p2at_omni_live", metavar="FILE",
        help="robot ini, or the name of a bundled one")  # fmt: skip
    add("--world", default="laboratory", metavar="FILE",
        help="world ini with landmarks, or the name of a bundled one")  # fmt: skip
    add("--view", type=parse_port, default=_DEFAULT_VIEW_PORT, metavar="PORT",
        help="port of the page; 0 = free ports for page, control, images and stream")  # fmt: skip
    add("--laps", type=parse_count, metavar="N", help="end after N laps (default: none)")
    add("--seed", type=parse_integer, default=0, metavar="N",
        help="seed of the server's random numbers")  # fmt: skip
    add_output(parser, "out/live", "folder of the server's log")
    return parser
