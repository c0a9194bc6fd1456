"""A check of a live server by physics, and what it may assume about the server.

Conversations (conversation_file.py) test the grammar of replies; checks test that the replies
describe one world: odometry, scan, pose and picture against each other.
"""

from __future__ import annotations

import functools
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from catoptra_client.frame_sources.stream.zmq_socket import StreamSocket
from conformance.conversation_file import Address


class CheckFailed(Exception):  # noqa: N818  # an outcome of a check, not an error of the suite
    """The server contradicts itself or the protocol: what was expected, what was observed."""


class CheckSkipped(Exception):  # noqa: N818  # an outcome of a check, not an error of the suite
    """The check does not apply to this server: the reason, for the table of results."""


@dataclass(frozen=True, slots=True)
class ServerUnderTest:
    """A live server, ours or another's, and how to get a robot in it."""

    addresses: dict[str, Address]
    """Address of the ports `control`, `image` and `stream`; those that were not given are absent.
    """
    robot_class: str
    """Class of INIT."""
    spawn_pose: str
    """Blocks of INIT with the pose to spawn at."""
    dialect: str
    """`ut2004` or `udk`."""
    legacy_images: bool
    """Whether the image port sends a frame before any request."""
    clock: Callable[[], float] = time.monotonic
    """Clock of the checks of the stream, seconds."""
    replace_socket: Callable[[StreamSocket], StreamSocket] | None = None
    """Takes the place of a new socket of the stream: records it, replays it, or is a page's."""
    is_recording: bool = False
    """Whether it shows what was recorded; its greeting says so."""
    change_document: Callable[[str, dict[str, Any]], dict[str, Any]] | None = None
    """Deliberate fault of a JSON document of the page, by its path."""


def rejection_of_recording(text: str) -> str:
    """Reason in a text for which a recording that is served does not answer; else empty."""
    return found[0] if (found := re.search(r"a recording cannot [^}]*", text)) else ""


@dataclass(frozen=True, slots=True)
class Check:
    """One row of the table of results."""

    name: str
    port: str
    """Port that the check is about; it applies to servers with an address of this port."""
    description: str
    run: Callable[[ServerUnderTest], None]
    """Returns if the server passes; raises CheckFailed, CheckSkipped, OSError (a connection that
    broke) or CatoptraError (a reply that cannot be parsed), of which all but CheckSkipped fail.
    """
    needs_robot: bool = True
    """Whether it fails without being run on a server where no robot spawns."""
    is_required: bool = True
    """Whether a server must pass it."""
    needs_empty_world: bool = False
    """Whether robots of other connections would be in its way."""


def check_from_function(
    name: str, port: str, run: Callable[[ServerUnderTest], None], *, needs_robot: bool = True
) -> Check:
    """Required check whose description is the first line of the function's docstring."""
    return Check(name, port, (run.__doc__ or "").partition("\n")[0], run, needs_robot)


def retry_once(run: Callable[[ServerUnderTest], None]) -> Callable[[ServerUnderTest], None]:
    """A check that a delay may fail, repeated once if it does.

    A busy machine delays a command, a report or the end of a connection by tenths of seconds,
    rarely twice in a row; a wrong server fails both times.
    """

    @functools.wraps(run)
    def run_at_most_twice(server: ServerUnderTest) -> None:
        try:
            run(server)
        except CheckFailed:
            run(server)

    return run_at_most_twice
