"""Conformance test of a live server, ours or another's: the conversations of USARSim's clients.

Run: make conformance ADDRESS=host:port [IMAGE=host:port] [STREAM=host:port] [DIALECT=udk]
[LEGACY=yes], or, in tests/, `python -m conformance.play host:port`. The conversations are the files
of data/conversations; those for ports without an address, or for servers of another kind, are
skipped. The server's clock must be realtime. Prints a table; exits with 0 if every required one
passes.
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
    """Outcome of one conversation."""

    conversation: Conversation
    reason: str
    """Failed step and reason; empty if passed."""

    @property
    def is_failure(self) -> bool:
        """Whether the server fails a required conversation."""
        return bool(self.reason) and self.conversation.is_required


def read_conversations(folder: Path = CONVERSATIONS) -> list[Conversation]:
    """All conversations of a folder, by name."""
    return [read_conversation(path, STEP_KEYS) for path in sorted(folder.glob("*.json"))]


def play_all(
    conversations: Iterable[Conversation],
    addresses: dict[str, Address],
    robot_class: str,
    spawn_pose: str,
) -> list[ConversationResult]:
    """Play conversations one after the other.

    Args:
        conversations: Conversations of ports in `addresses`.
        addresses: Address of each port.
        robot_class: Class to spawn.
        spawn_pose: Blocks of INIT with the pose to spawn at.
    """
    variables = {"class": robot_class, "spawn_pose": spawn_pose}
    return [
        ConversationResult(one, PLAYERS[one.port](one, addresses[one.port], variables))
        for one in conversations
    ]


def find_start_pose(address: Address) -> str:
    """Blocks of INIT with the first start pose of the server, or else the origin."""
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
    """Table of results by port."""
    table = Table("port", "conversation", "description", "result")
    for port in PLAYERS:
        for result in (one for one in results if one.conversation.port == port):
            played = result.conversation
            name = played.name if played.is_required else f"{played.name} (not required)"
            outcome = f"[red]{_escape_markup(result.reason)}" if result.reason else "[green]passed"
            table.add_row(port, name, _escape_markup(played.description), outcome)
        table.add_section()
    return table


def main(arguments: Sequence[str] | None = None) -> int:
    """Play all applicable conversations; exit status."""
    parser = argparse.ArgumentParser(description="Play the conversations to a live server.")
    parser.add_argument("control", type=_parse_address, help="host:port of the control server")
    parser.add_argument("--image", type=_parse_address, help="host:port of the image server")
    parser.add_argument("--stream", type=_parse_address, help="host:port of the ZeroMQ stream")
    parser.add_argument("--dialect", choices=("ut2004", "udk"), default="ut2004")
    parser.add_argument(
        "--legacy-images", action="store_true", help="server sends an unsolicited frame"
    )
    parser.add_argument("--robot-class", default="USARBot.OmniP2AT")
    parser.add_argument(
        "--spawn-pose", help="blocks of INIT, {Location 1,2,0}; default: a start pose"
    )
    options = parser.parse_args(arguments)
    ports = {"control": options.control, "image": options.image, "stream": options.stream}
    addresses = {port: address for port, address in ports.items() if address}
    image_mode = "legacy" if options.legacy_images else "plain"
    applicable = [
        one
        for one in read_conversations()
        if one.applies_to(options.dialect, image_mode) and one.port in addresses
    ]
    spawn_pose = options.spawn_pose or find_start_pose(options.control)
    results = play_all(applicable, addresses, options.robot_class, spawn_pose)
    Console().print(results_table(results))
    failed = sum(result.is_failure for result in results)
    print(f"{len(results) - failed} of {len(results)} passed or not required")
    # No conversation at all is a failure, too: a wrong option would pass otherwise.
    return 1 if failed or not results else 0


def _parse_address(text: str) -> Address:
    host, _, port = text.rpartition(":")
    try:
        return host or "127.0.0.1", int(port)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: expected host:port") from error


def _escape_markup(text: str) -> str:
    """Text without markup for rich."""
    return text.replace("[", r"\[")


if __name__ == "__main__":
    sys.exit(main())
