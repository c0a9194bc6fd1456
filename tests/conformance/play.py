"""Does a live server, ours or another's, hold the conversations that USARSim's clients hold?

Run: make conformance ADDRESS=host:port [IMAGE=host:port] [STREAM=host:port] [DIALECT=udk]
[LEGACY=yes], or, in tests/, `python -m conformance.play host:port`. The conversations are the files
of data/conversations; those for ports without an address, or for servers of another kind, are left
out. The server's clock must run by itself. Prints a table; exits with 0 if all that is required
passed.
"""

from __future__ import annotations

import argparse
import socket
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from catoptra_protocol.wire.connection import ControlClient
from catoptra_protocol.wire.reports import StartPoses
from conformance import conversation, stream_conversation
from conformance.script import WITHIN_S, Address, Conversation, read_conversation

CONVERSATIONS = Path(__file__).parent / "data/conversations"

Hold = Callable[[Conversation, Address, dict[str, str]], str]
HOLD: dict[str, Hold] = {
    "control": conversation.hold,
    "image": conversation.hold,
    "stream": stream_conversation.hold,
}
_TCP_KEYS = {*conversation.STEPS, *conversation.SETTINGS}
KEYS = {
    "control": _TCP_KEYS,
    "image": _TCP_KEYS,
    "stream": {*stream_conversation.STEPS, *stream_conversation.SETTINGS},
}


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of one conversation: an empty reason means that it passed."""

    conversation: Conversation
    reason: str

    @property
    def is_failure(self) -> bool:
        """Return whether the server lacks what it must have."""
        return bool(self.reason) and self.conversation.required


def conversations(folder: Path = CONVERSATIONS) -> list[Conversation]:
    """Return all conversations of a folder."""
    return [read_conversation(path, KEYS) for path in sorted(folder.glob("*.json"))]


def play(
    them: Iterable[Conversation], addresses: dict[str, Address], robot_class: str, place: str
) -> list[Verdict]:
    """Hold the conversations for whose port there is an address, one after the other."""
    words = {"class": robot_class, "place": place}
    return [Verdict(one, HOLD[one.port](one, addresses[one.port], words)) for one in them]


def first_start(address: Address) -> str:
    """Return the blocks that place a robot: the first start pose told, or else the origin."""
    client = ControlClient()
    with socket.create_connection(address, timeout=WITHIN_S) as connection:
        connection.sendall(b"GETSTARTPOSES\r\n")
        while data := connection.recv(4096):
            for report in client.receive(data):
                if isinstance(report, StartPoses) and report.poses:
                    return f"{{Start {report.poses[0].name}}}"
                if isinstance(report, StartPoses):
                    return "{Location 0,0,0}"
    return "{Location 0,0,0}"


def table(verdicts: Sequence[Verdict]) -> Table:
    """Return the table: what was played, what it shows, how it went; by port."""
    shown = Table("port", "conversation", "what it shows", "verdict")
    for port in HOLD:
        for verdict in (one for one in verdicts if one.conversation.port == port):
            one = verdict.conversation
            name = one.name if one.required else f"{one.name} (not required)"
            how = f"[red]{_plain(verdict.reason)}" if verdict.reason else "[green]passed"
            shown.add_row(port, name, _plain(one.why), how)
        shown.add_section()
    return shown


def main(arguments: Sequence[str] | None = None) -> int:
    """Play everything; return the exit status."""
    parser = argparse.ArgumentParser(description="Play the conversations to a live server.")
    parser.add_argument("control", type=_address, help="host:port of the control server")
    parser.add_argument("--image", type=_address, help="host:port of the image server")
    parser.add_argument("--stream", type=_address, help="host:port of the ZeroMQ stream")
    parser.add_argument("--dialect", choices=("ut2004", "udk"), default="ut2004")
    parser.add_argument("--legacy-images", action="store_true", help="one frame comes unasked")
    parser.add_argument("--robot-class", default="USARBot.OmniP2AT")
    parser.add_argument("--place", help="blocks of INIT, {Location 1,2,0}; else a start pose")
    given = parser.parse_args(arguments)
    ports = {"control": given.control, "image": given.image, "stream": given.stream}
    addresses = {port: address for port, address in ports.items() if address}
    images = "legacy" if given.legacy_images else "plain"
    fitting = (one for one in conversations() if one.fits(given.dialect, images))
    played = [one for one in fitting if one.port in addresses]
    place = given.place or first_start(given.control)
    verdicts = play(played, addresses, given.robot_class, place)
    Console().print(table(verdicts))
    failed = sum(verdict.is_failure for verdict in verdicts)
    print(f"{len(verdicts) - failed} of {len(verdicts)} passed or not required")
    return 1 if failed or not verdicts else 0


def _address(text: str) -> Address:
    host, _, port = text.rpartition(":")
    try:
        return host or "127.0.0.1", int(port)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: expected host:port") from error


def _plain(text: str) -> str:
    """Return a text in which rich finds no markup."""
    return text.replace("[", r"\[")


if __name__ == "__main__":
    sys.exit(main())
