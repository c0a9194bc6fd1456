"""Hold a conversation on the modern stream as a data file tells.

What each step holds is told at its function below. Messages are packed here from what the file
says, so that it may say what our own code never would. Every answer is read as a whole, and of
every frame it is checked that its picture is what its header says, and newer than the last one.
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

from catoptra_client.frame_sources.stream.frame_decoding import CameraModelCache, frame_from_parts
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

FieldMap = dict[str, Any]  # as msgpack holds them


@dataclass(slots=True)
class DealerConnection:
    """One connection: it counts its requests and looks at the frames that come."""

    socket: zmq.Socket[bytes]
    ids: Iterator[int] = field(default_factory=lambda: itertools.count(1))
    last_sequence: int = 0
    camera_models: CameraModelCache = field(default_factory=CameraModelCache)

    def iter_messages(self, timeout_s: float) -> Iterator[FieldMap]:
        """Yield the fields of messages until the time is up."""
        deadline_s = time.monotonic() + timeout_s
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            if self.socket.poll(max(1, round(1000.0 * left_s))):
                yield self._check_message(self.socket.recv_multipart())

    def iter_replies(self, timeout_s: float = TIMEOUT_S) -> Iterator[FieldMap]:
        """Yield the fields of messages that are no pulses until the time is up."""
        return (fields for fields in self.iter_messages(timeout_s) if fields["kind"] != "pulse")

    def _check_message(self, parts: list[bytes]) -> FieldMap:
        answer = reply_from_bytes(parts[0])
        if isinstance(answer, FrameHeader):
            frame_from_parts(answer, parts[1:], camera_cache=self.camera_models, received_s=0.0)
            if answer.sequence <= self.last_sequence:
                raise StepFailedError(f"frame {answer.sequence} after {self.last_sequence}")
            self.last_sequence = answer.sequence
        elif len(parts) != 1:
            raise StepFailedError(f"{len(parts) - 1} parts behind an answer")
        fields: FieldMap = msgpack.unpackb(parts[0])
        return fields


@dataclass(slots=True)
class StreamSession:
    """Where a conversation stands: its connection, and the words that `$name` stands for."""

    address: Address
    variables: dict[str, str]
    context: zmq.Context[zmq.Socket[bytes]]
    connection: DealerConnection | None = None

    def connect(self) -> DealerConnection:
        """Return the connection, made when first needed."""
        if self.connection is None:
            socket = self.context.socket(zmq.DEALER)
            socket.set(zmq.LINGER, 0)
            socket.connect("tcp://{}:{}".format(*self.address))
            self.connection = DealerConnection(socket)
        return self.connection


def play_conversation(
    conversation: Conversation, address: Address, variables: dict[str, str]
) -> str:
    """Hold the conversation; return an empty text, or what went wrong and at which step."""
    with ExitStack() as ends:
        stage = StreamSession(address, dict(variables), zmq.Context())
        ends.callback(stage.context.destroy, linger=0)
        for number, step in enumerate(conversation.steps, 1):
            try:
                for key in step.keys() - STEP_OPTIONS:
                    STEP_HANDLERS[key](stage, step)
            except (StepFailedError, CatoptraError) as error:
                return f"step {number} ({next(iter(step))}): {error}"
    return ""


def _send_request(session: StreamSession, step: StepSpec) -> None:
    """`ask`: fields of a request, or a list of requests that are sent at once.

    `answer`: what the answer has, or a list in order; as `id`, the request's is taken. A text is a
    pattern; a list holds what must come in this order, other things between. A spawn's class and
    place are filled in. With `again`, asked again until the answer is so.
    """
    peer, deadline_s = session.connect(), time.monotonic() + TIMEOUT_S
    while True:
        requests = [_complete_request(session, fields) for fields in _as_list(step["ask"])]
        for request in requests:
            peer.socket.send(msgpack.packb(request))
        reasons = [
            _find_difference({**answer, "id": answer.get("id", request["id"])}, _next_reply(peer))
            for request, answer in zip(requests, _as_list(step["answer"]), strict=True)
        ]
        if not any(reasons):
            return
        if not step.get("again") or time.monotonic() > deadline_s:
            raise StepFailedError("; ".join(filter(None, reasons)))


def _send_vectors(session: StreamSession, step: StepSpec) -> None:
    """`send_vectors`: names of vectors; each is sent and must be answered by `answer`."""
    for name in step["send_vectors"]:
        session.connect().socket.send((VECTORS / f"{name}.bytes").read_bytes())
        if reason := _find_difference(step["answer"], _next_reply(session.connect())):
            raise StepFailedError(f"{name}: {reason}")


def _send_parts(session: StreamSession, step: StepSpec) -> None:
    """`send_parts`: the parts of one message, in hexadecimal; it must be answered by `answer`."""
    parts = [bytes.fromhex(part) for part in step["send_parts"]]
    session.connect().socket.send_multipart(parts)
    if reason := _find_difference(step["answer"], _next_reply(session.connect())):
        raise StepFailedError(reason)


def _expect_heartbeats(session: StreamSession, step: StepSpec) -> None:
    """`pulses`: so many come unasked `within_s` seconds."""
    seen = (fields for fields in session.connect().iter_messages(step["within_s"]))
    count = sum(fields["kind"] == "pulse" for fields in seen)
    if count < step["pulses"]:
        raise StepFailedError(f"{count} pulses came in {step['within_s']} s")


def _expect_silence(session: StreamSession, step: StepSpec) -> None:
    """`silence_for_s`: nothing but pulses comes for so long."""
    for fields in session.connect().iter_replies(step["silence_for_s"]):
        raise StepFailedError(f"{_abbreviate(fields)} was not to come")


def _close_connection(session: StreamSession, step: StepSpec) -> None:
    """`close`: end the connection; the next step makes another."""
    session.connect().socket.close()
    session.connection = None


def _next_reply(connection: DealerConnection) -> FieldMap:
    for fields in connection.iter_replies():
        return fields
    raise StepFailedError(f"no answer came within {TIMEOUT_S:g} s")


def _complete_request(session: StreamSession, fields: FieldMap) -> FieldMap:
    request = {"id": next(session.connect().ids), **fields}
    if request["kind"] == "ask_spawn":
        request = {**_spawn_fields(session.variables), "name": None, **request}
    return request


def _spawn_fields(variables: dict[str, str]) -> FieldMap:
    """Return what the words say of a robot: its class, and its place as blocks of INIT."""
    blocks = parse_message(Template("INIT $place").substitute(variables))
    location, rotation = blocks.get("Location"), blocks.get("Rotation")
    return {
        "class_name": variables["class"],
        "location_m": None if location is None else list(vector_from_text(location)),
        "rotation_rad": [0.0, 0.0, 0.0] if rotation is None else list(vector_from_text(rotation)),
        "start": blocks.get("Start"),
    }


def _find_difference(expected: object, actual: object, path: str = "") -> str:
    """Return how a value departs from what is expected; empty if it does not."""
    if isinstance(expected, dict) and isinstance(actual, dict):
        found = (_find_field_difference(expected[key], actual, key, path) for key in expected)
        return next(filter(None, found), "")
    if isinstance(expected, list) and isinstance(actual, list):
        rest = iter(actual)
        lost = [one for one in expected if all(_find_difference(one, other) for other in rest)]
        return f"{path[1:]}: nothing like {lost[0]!r}" if lost else ""
    if isinstance(expected, str) and isinstance(actual, str):
        is_so = bool(re.fullmatch(expected, actual, re.DOTALL))
    else:
        is_so = expected == actual
    return "" if is_so else f"{path[1:]} {_abbreviate(actual)}, not {expected!r}"


def _find_field_difference(expected: object, actual: FieldMap, key: str, path: str) -> str:
    if key not in actual:
        return f"{path[1:]} without the field {key!r}"
    reason = _find_difference(expected, actual[key], f"{path}.{key}")
    return f"{reason}: {actual['reason']}" if reason and "reason" in actual else reason


def _as_list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _abbreviate(value: object) -> str:
    return repr(value)[:100]


STEP_HANDLERS: dict[str, Callable[[StreamSession, StepSpec], None]] = {
    "ask": _send_request,
    "send_vectors": _send_vectors,
    "send_parts": _send_parts,
    "pulses": _expect_heartbeats,
    "silence_for_s": _expect_silence,
    "close": _close_connection,
}
STEP_OPTIONS = {"answer", "again", "within_s"}
