"""Player of the conversations on the ZeroMQ stream.

The key of a step selects its handler in STEP_HANDLERS; the handler's docstring documents the step.
Requests are packed from the file's fields with msgpack directly, so that a file may contain
messages that our own code never sends. Images of frames are for the checks of the stream.

To add a step: its handler and its entry in STEP_HANDLERS, its options in STEP_OPTIONS.
"""

from __future__ import annotations

import itertools
import re
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from string import Template
from typing import Any

import msgpack
import zmq

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.stream.messages import reply_from_bytes
from catoptra_protocol.stream.replies import FrameHeader
from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_protocol.usarsim.value_format import vector_from_text
from conformance.conversation_file import (
    TIMEOUT_S,
    Address,
    Conversation,
    StepFailedError,
    StepSpec,
)

VECTORS = Path(__file__).parent / "data/stream"

FieldMap = dict[str, Any]  # Any: every value of msgpack


@dataclass(slots=True)
class DealerConnection:
    """One connection with its own request ids, which checks all arriving messages."""

    socket: zmq.Socket[bytes]
    ids: Iterator[int] = field(default_factory=lambda: itertools.count(1))

    def iter_messages(self, timeout_s: float) -> Iterator[FieldMap]:
        """Iterate over the fields of messages until the timeout."""
        deadline_s = time.monotonic() + timeout_s
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            if self.socket.poll(max(1, round(1000.0 * left_s))):
                yield self._check_message(self.socket.recv_multipart())

    def iter_replies(self, timeout_s: float = TIMEOUT_S) -> Iterator[FieldMap]:
        """Iterate over the fields of messages other than heartbeats until the timeout."""
        return (fields for fields in self.iter_messages(timeout_s) if fields["kind"] != "heartbeat")

    def _check_message(self, parts: list[bytes]) -> FieldMap:
        if not isinstance(reply_from_bytes(parts[0]), FrameHeader) and len(parts) != 1:
            raise StepFailedError(f"{len(parts) - 1} parts after a reply")
        fields: FieldMap = msgpack.unpackb(parts[0])
        return fields


@dataclass(slots=True)
class StreamSession:
    """State of a conversation in progress."""

    address: Address
    variables: dict[str, str]
    """Text of each `$name`."""
    context: zmq.Context[zmq.Socket[bytes]]
    connection: DealerConnection | None = None

    def connect(self) -> DealerConnection:
        """Current connection, opened on first use."""
        if self.connection is None:
            socket = self.context.socket(zmq.DEALER)
            socket.set(zmq.LINGER, 0)
            socket.connect("tcp://{}:{}".format(*self.address))
            self.connection = DealerConnection(socket)
        return self.connection


def play_conversation(
    conversation: Conversation, address: Address, variables: dict[str, str]
) -> str:
    """Play a conversation; empty if passed, else the failed step and the reason."""
    with ExitStack() as exit_stack:
        session = StreamSession(address, dict(variables), zmq.Context())
        exit_stack.callback(session.context.destroy, linger=0)
        for number, step in enumerate(conversation.steps, 1):
            try:
                for key in step.keys() - STEP_OPTIONS:
                    STEP_HANDLERS[key](session, step)
            except (StepFailedError, CatoptraError) as error:
                return f"step {number} ({next(iter(step))}): {error}"
    return ""


def _send_request(session: StreamSession, step: StepSpec) -> None:
    """`request`: fields of a request, or a list of requests that are sent at once.

    `reply`: expected fields of the reply, or a list in order; its default `id` is that of the
    request. A text is a pattern; a list holds elements in this order, others between. Class and
    pose of a spawn are filled in. With `retry` the request is repeated until the reply matches.
    """
    connection, deadline_s = session.connect(), time.monotonic() + TIMEOUT_S
    while True:
        requests = [_complete_request(session, fields) for fields in _as_list(step["request"])]
        for request in requests:
            connection.socket.send(msgpack.packb(request))
        reasons = [
            _find_difference({"id": request["id"], **reply}, _next_reply(connection))
            for request, reply in zip(requests, _as_list(step["reply"]), strict=True)
        ]
        if not any(reasons):
            return
        if not step.get("retry") or time.monotonic() > deadline_s:
            raise StepFailedError("; ".join(filter(None, reasons)))


def _send_vectors(session: StreamSession, step: StepSpec) -> None:
    """`send_vectors`: names of vectors; each is sent, and its reply must match `reply`."""
    for name in step["send_vectors"]:
        session.connect().socket.send((VECTORS / f"{name}.bytes").read_bytes())
        if reason := _find_difference(step["reply"], _next_reply(session.connect())):
            raise StepFailedError(f"{name}: {reason}")


def _send_parts(session: StreamSession, step: StepSpec) -> None:
    """`send_parts`: the parts of one message, in hexadecimal; its reply must match `reply`."""
    parts = [bytes.fromhex(part) for part in step["send_parts"]]
    session.connect().socket.send_multipart(parts)
    if reason := _find_difference(step["reply"], _next_reply(session.connect())):
        raise StepFailedError(reason)


def _expect_heartbeats(session: StreamSession, step: StepSpec) -> None:
    """`heartbeats`: minimum number of unsolicited heartbeats in `timeout_s` seconds."""
    messages = session.connect().iter_messages(step["timeout_s"])
    heartbeats = (fields for fields in messages if fields["kind"] == "heartbeat")
    count = len(list(itertools.islice(heartbeats, step["heartbeats"])))
    if count < step["heartbeats"]:
        raise StepFailedError(f"{count} heartbeats in {step['timeout_s']} s")


def _expect_silence(session: StreamSession, step: StepSpec) -> None:
    """`silence_for_s`: no message except heartbeats for this time."""
    for fields in session.connect().iter_replies(step["silence_for_s"]):
        raise StepFailedError(f"{_abbreviate(fields)} was not expected")


def _close_connection(session: StreamSession, step: StepSpec) -> None:
    """`close`: end the connection; the next step opens another."""
    session.connect().socket.close()
    session.connection = None


def _next_reply(connection: DealerConnection) -> FieldMap:
    for fields in connection.iter_replies():
        return fields
    raise StepFailedError(f"no reply within {TIMEOUT_S:g} s")


def _complete_request(session: StreamSession, fields: FieldMap) -> FieldMap:
    request = {"id": next(session.connect().ids), **fields}
    if request["kind"] == "spawn":
        request = {**_spawn_fields(session.variables), "name": None, **request}
    return request


def _spawn_fields(variables: dict[str, str]) -> FieldMap:
    """Fields of a spawn request in the variables: the class, and the pose as blocks of INIT."""
    blocks = parse_message(Template("INIT $spawn_pose").substitute(variables))
    location, rotation = blocks.get("Location"), blocks.get("Rotation")
    return {
        "class_name": variables["class"],
        "location_m": None if location is None else list(vector_from_text(location)),
        "rotation_rad": [0.0, 0.0, 0.0] if rotation is None else list(vector_from_text(rotation)),
        "start": blocks.get("Start"),
    }


def _find_difference(expected: object, actual: object, path: str = "") -> str:
    """First difference between a value and its expectation; empty if there is none."""
    if isinstance(expected, dict) and isinstance(actual, dict):
        found = (_find_field_difference(expected[key], actual, key, path) for key in expected)
        return next(filter(None, found), "")
    if isinstance(expected, list) and isinstance(actual, list):
        # One iterator for all elements: each is searched after the match of its predecessor.
        rest = iter(actual)
        missing = [one for one in expected if all(_find_difference(one, other) for other in rest)]
        return f"{path[1:]}: no element {missing[0]!r}" if missing else ""
    if isinstance(expected, str) and isinstance(actual, str):
        matches = bool(re.fullmatch(expected, actual, re.DOTALL))
    else:
        matches = expected == actual
    return "" if matches else f"{path[1:]} {_abbreviate(actual)}, not {expected!r}"


def _find_field_difference(expected: object, actual: FieldMap, key: str, path: str) -> str:
    if key not in actual:
        return f"{path[1:]} without the field {key!r}"
    # The reason of an error reply explains the difference better than the kinds do.
    reason = _find_difference(expected, actual[key], f"{path}.{key}")
    return f"{reason}: {actual['reason']}" if reason and "reason" in actual else reason


def _as_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _abbreviate(value: object) -> str:
    return repr(value)[:100]


STEP_HANDLERS: dict[str, Callable[[StreamSession, StepSpec], None]] = {
    "request": _send_request,
    "send_vectors": _send_vectors,
    "send_parts": _send_parts,
    "heartbeats": _expect_heartbeats,
    "silence_for_s": _expect_silence,
    "close": _close_connection,
}
STEP_OPTIONS = {"reply", "retry", "timeout_s"}
