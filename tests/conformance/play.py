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

from catoptra_protocol.usarsim.control_connection import ControlClient
from catoptra_protocol.usarsim.reports import StartPoses
from conformance import stream_player, tcp_player
from conformance.conversation_file import TIMEOUT_S, Address, Conversation, read_conversation

CONVERSATIONS = Path(__file__).parent / "data/conversations"

Player = Callable[[Conversation, Address, dict[str, str]], str]
PLAYERS: dict[str, Player] = {
    "control": tcp_player.play_conversation,
    "image": tcp_player.play_conversation,
    "stream": stream_player.play_conversation,
}
_TCP_STEP_KEYS = {*tcp_player.STEP_HANDLERS, *tcp_player.STEP_OPTIONS}
STEP_KEYS = {
    "control": _TCP_STEP_KEYS,
    "image": _TCP_STEP_KEYS,
    "stream": {*stream_player.STEP_HANDLERS, *stream_player.STEP_OPTIONS},
}


@dataclass(frozen=True, slots=True)
class ConversationResult:
    """What became of one conversation: an empty reason means that it passed."""

    conversation: Conversation
    reason: str

    @property
    def is_failure(self) -> bool:
        """Return whether the server lacks what it must have."""
        return bool(self.reason) and self.conversation.is_required


def read_conversations(folder: Path = CONVERSATIONS) -> list[Conversation]:
    """Return all conversations of a folder."""
    return [read_conversation(path, STEP_KEYS) for path in sorted(folder.glob("*.json"))]


def play_all(
    conversations: Iterable[Conversation],
    addresses: dict[str, Address],
    robot_class: str,
    placement_blocks: str,
) -> list[ConversationResult]:
    """Hold the conversations for whose port there is an address, one after the other."""
    words = {"class": robot_class, "place": placement_blocks}
    return [
        ConversationResult(one, PLAYERS[one.port](one, addresses[one.port], words))
        for one in conversations
    ]


def find_start_pose(address: Address) -> str:
    """Return the blocks that place a robot: the first start pose told, or else the origin."""
    client = ControlClient()
    with socket.create_connection(address, timeout=TIMEOUT_S) as connection:
        connection.sendall(b"GETSTARTPOSES\r\n")
        while data := connection.recv(4096):
            for report in client.receive(data):
                if isinstance(report, StartPoses) and report.poses:
                    return f"{{Start {report.poses[0].name}}}"
                if isinstance(report, StartPoses):
                    return "{Location 0,0,0}"
    return "{Location 0,0,0}"


def results_table(results: Sequence[ConversationResult]) -> Table:
    """Return the table: what was played, what it shows, how it went; by port."""
    shown = Table("port", "conversation", "what it shows", "verdict")
    for port in PLAYERS:
        for verdict in (one for one in results if one.conversation.port == port):
            one = verdict.conversation
            name = one.name if one.is_required else f"{one.name} (not required)"
            how = f"[red]{_escape_markup(verdict.reason)}" if verdict.reason else "[green]passed"
            shown.add_row(port, name, _escape_markup(one.description), how)
        shown.add_section()
    return shown


def main(arguments: Sequence[str] | None = None) -> int:
    """Play everything; return the exit status."""
    parser = argparse.ArgumentParser(description="Play the conversations to a live server.")
    parser.add_argument("control", type=_parse_address, help="host:port of the control server")
    parser.add_argument("--image", type=_parse_address, help="host:port of the image server")
    parser.add_argument("--stream", type=_parse_address, help="host:port of the ZeroMQ stream")
    parser.add_argument("--dialect", choices=("ut2004", "udk"), default="ut2004")
    parser.add_argument("--legacy-images", action="store_true", help="one frame comes unasked")
    parser.add_argument("--robot-class", default="USARBot.OmniP2AT")
    parser.add_argument("--place", help="blocks of INIT, {Location 1,2,0}; else a start pose")
    given = parser.parse_args(arguments)
    ports = {"control": given.control, "image": given.image, "stream": given.stream}
    addresses = {port: address for port, address in ports.items() if address}
    images = "legacy" if given.legacy_images else "plain"
    fitting = (one for one in read_conversations() if one.applies_to(given.dialect, images))
    played = [one for one in fitting if one.port in addresses]
    place = given.place or find_start_pose(given.control)
    verdicts = play_all(played, addresses, given.robot_class, place)
    Console().print(results_table(verdicts))
    failed = sum(verdict.is_failure for verdict in verdicts)
    print(f"{len(verdicts) - failed} of {len(verdicts)} passed or not required")
    return 1 if failed or not verdicts else 0


def _parse_address(text: str) -> Address:
    host, _, port = text.rpartition(":")
    try:
        return host or "127.0.0.1", int(port)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: expected host:port") from error


def _escape_markup(text: str) -> str:
    """Return a text in which rich finds no markup."""
    return text.replace("[", r"\[")


if __name__ == "__main__":
    sys.exit(main())
