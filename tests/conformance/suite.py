"""The rows of the suite, conversations as well as checks, and their results.

A row never raises: whatever goes wrong while it is played is its result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from catoptra_protocol.errors import CatoptraError
from conformance import stream_player, tcp_player
from conformance.check import (
    Check,
    CheckFailed,
    CheckSkipped,
    ServerUnderTest,
    rejection_of_recording,
)
from conformance.control_checks import CONTROL_CHECKS, SPAWN_CHECK
from conformance.control_session import spawn_robot
from conformance.conversation_file import Address, Conversation, read_conversation
from conformance.image_checks import IMAGE_CHECKS
from conformance.page_checks import PAGE_CHECKS
from conformance.stream_checks import STREAM_CHECKS

CONVERSATIONS = Path(__file__).parent / "data/conversations"

Player = Callable[[Conversation, Address, dict[str, str]], str]
PLAYERS: dict[str, Player] = {
    "control": tcp_player.play_conversation,
    "image": tcp_player.play_conversation,
    "stream": stream_player.play_conversation,
    "page": stream_player.play_conversation,
}
_TCP_STEP_KEYS = {*tcp_player.STEP_HANDLERS, *tcp_player.STEP_OPTIONS}
STEP_KEYS: dict[str, Iterable[str]] = {
    "control": _TCP_STEP_KEYS,
    "image": _TCP_STEP_KEYS,
    "stream": {*stream_player.STEP_HANDLERS, *stream_player.STEP_OPTIONS},
    "page": (),
}
CHECKS: tuple[Check, ...] = (*CONTROL_CHECKS, *IMAGE_CHECKS, *STREAM_CHECKS, *PAGE_CHECKS)


# What a recording cannot reject, since it answers by what it has.
BEYOND_RECORDINGS = {
    "stream_encodings": "a recording cannot hold its robot still between two pictures",
    "image_region_content": "a recording cannot hold its robot still between two pictures",
    "stream_close_releases_the_robot": "a recording cannot give its robot another name",
    "stream_frame_without_robot": "a recording cannot be without its robot",
    "stream_reset": "a recording cannot give its robot another name",
    "stream_spawn": "a recording cannot have a second robot",
    "stream_start_poses": "a recording cannot put its robot back to its start",
    "stream_state_and_notes": "a recording cannot give its robot another name",
}


class Outcome(Enum):
    """Result of a row, in a word."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"
    NOT_REQUIRED = "not required"


@dataclass(frozen=True, slots=True)
class RowResult:
    """Result of a conversation or check."""

    check: Check
    outcome: Outcome
    reason: str = ""
    """Of a row that did not pass."""


def read_conversations(folder: Path = CONVERSATIONS) -> list[Conversation]:
    """All conversations of a folder, by name."""
    return [read_conversation(path, STEP_KEYS) for path in sorted(folder.glob("*.json"))]


def applicable_checks(server: ServerUnderTest) -> list[Check]:
    """Conversations and checks for a server of this dialect and image mode, by port."""
    image_mode = "legacy" if server.legacy_images else "plain"
    conversations = [
        check_from_conversation(one)
        for one in read_conversations()
        if one.applies_to(server.dialect, image_mode)
    ]
    return [
        check
        for port in PLAYERS
        for check in (*conversations, *CHECKS)
        if check.port == port and port in server.addresses
    ]


def check_from_conversation(conversation: Conversation) -> Check:
    """Check that plays a conversation."""

    def run(server: ServerUnderTest) -> None:
        if conversation.needed_part:
            _require_part(server, conversation.needed_part)
        variables = {"class": server.robot_class, "spawn_pose": server.spawn_pose}
        play = PLAYERS[conversation.port]
        reason = play(conversation, server.addresses[conversation.port], variables)
        if reason:
            raise CheckFailed(reason)

    needs_robot = any("$class" in step.get("send", "") for step in conversation.steps)
    return Check(
        conversation.name,
        conversation.port,
        conversation.description,
        run,
        needs_robot,
        conversation.is_required,
    )


def _require_part(server: ServerUnderTest, type_: str) -> None:
    """Skip a robot without a part of this type."""
    with spawn_robot(server) as session:
        if not any(one.get("Name") for one in session.query(f"GETCONF {{Type {type_}}}")):
            raise CheckSkipped(f"{server.robot_class} has no {type_}")


def play_checks(checks: Iterable[Check], server: ServerUnderTest) -> Iterator[RowResult]:
    """Play checks one after the other; those that need a robot fail at once if none spawns."""
    spawning = play_check(SPAWN_CHECK, server)
    for check in checks:
        if check is SPAWN_CHECK:
            yield spawning
        elif check.needs_robot and spawning.outcome is not Outcome.PASSED:
            yield _fail(check, "not played: no robot spawns")
        else:
            yield play_check(check, server)


def play_check(check: Check, server: ServerUnderTest) -> RowResult:
    """Play one check."""
    if server.is_recording and check.name in BEYOND_RECORDINGS:
        return RowResult(check, Outcome.SKIPPED, BEYOND_RECORDINGS[check.name])
    try:
        check.run(server)
    except CheckSkipped as skipped:
        return RowResult(check, Outcome.SKIPPED, str(skipped))
    except (CheckFailed, CatoptraError) as failure:
        if reason := rejection_of_recording(str(failure)):
            return RowResult(check, Outcome.SKIPPED, reason)
        return _fail(check, str(failure))
    except OSError as error:
        return _fail(check, f"the connection broke: {error}")
    except Exception as error:  # a reply that no check expected must not end the whole suite
        return _fail(check, f"a reply that the check cannot read: {type(error).__name__}: {error}")
    return RowResult(check, Outcome.PASSED)


def _fail(check: Check, reason: str) -> RowResult:
    outcome = Outcome.FAILED if check.is_required else Outcome.NOT_REQUIRED
    return RowResult(check, outcome, reason)
