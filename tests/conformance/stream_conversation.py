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

from catoptra_client.stream_frame import CameraLaws, frame_from_parts
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.wire.grammar import parse_message
from catoptra_protocol.wire.numbers import vector_from_text
from catoptra_protocol.wire.stream import answer_from_bytes
from catoptra_protocol.wire.stream_answers import FrameHeader
from conformance.script import WITHIN_S, Address, Conversation, Step, UnexpectedError

VECTORS = Path(__file__).parent / "data/stream"

Fields = dict[str, Any]  # as msgpack holds them


@dataclass(slots=True)
class Peer:
    """One connection: it counts its requests and looks at the frames that come."""

    socket: zmq.Socket[bytes]
    ids: Iterator[int] = field(default_factory=lambda: itertools.count(1))
    last_sequence: int = 0
    laws: CameraLaws = field(default_factory=CameraLaws)

    def messages(self, within_s: float) -> Iterator[Fields]:
        """Yield the fields of messages until the time is up."""
        deadline_s = time.monotonic() + within_s
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            if self.socket.poll(max(1, round(1000.0 * left_s))):
                yield self._checked(self.socket.recv_multipart())

    def answers(self, within_s: float = WITHIN_S) -> Iterator[Fields]:
        """Yield the fields of messages that are no pulses until the time is up."""
        return (fields for fields in self.messages(within_s) if fields["kind"] != "pulse")

    def _checked(self, parts: list[bytes]) -> Fields:
        answer = answer_from_bytes(parts[0])
        if isinstance(answer, FrameHeader):
            frame_from_parts(answer, parts[1:], laws=self.laws, received_s=0.0)
            if answer.sequence <= self.last_sequence:
                raise UnexpectedError(f"frame {answer.sequence} after {self.last_sequence}")
            self.last_sequence = answer.sequence
        elif len(parts) != 1:
            raise UnexpectedError(f"{len(parts) - 1} parts behind an answer")
        fields: Fields = msgpack.unpackb(parts[0])
        return fields


@dataclass(slots=True)
class Stage:
    """Where a conversation stands: its connection, and the words that `$name` stands for."""

    address: Address
    words: dict[str, str]
    context: zmq.Context[zmq.Socket[bytes]]
    peer: Peer | None = None

    def connected(self) -> Peer:
        """Return the connection, made when first needed."""
        if self.peer is None:
            socket = self.context.socket(zmq.DEALER)
            socket.set(zmq.LINGER, 0)
            socket.connect("tcp://{}:{}".format(*self.address))
            self.peer = Peer(socket)
        return self.peer


def hold(conversation: Conversation, address: Address, words: dict[str, str]) -> str:
    """Hold the conversation; return an empty text, or what went wrong and at which step."""
    with ExitStack() as ends:
        stage = Stage(address, dict(words), zmq.Context())
        ends.callback(stage.context.destroy, linger=0)
        for number, step in enumerate(conversation.steps, 1):
            try:
                for key in step.keys() - SETTINGS:
                    STEPS[key](stage, step)
            except (UnexpectedError, CatoptraError) as error:
                return f"step {number} ({next(iter(step))}): {error}"
    return ""


def _ask(stage: Stage, step: Step) -> None:
    """`ask`: fields of a request, or a list of requests that are sent at once.

    `answer`: what the answer has, or a list in order; as `id`, the request's is taken. A text is a
    pattern; a list holds what must come in this order, other things between. A spawn's class and
    place are filled in. With `again`, asked again until the answer is so.
    """
    peer, deadline_s = stage.connected(), time.monotonic() + WITHIN_S
    while True:
        requests = [_request(stage, fields) for fields in _listed(step["ask"])]
        for request in requests:
            peer.socket.send(msgpack.packb(request))
        reasons = [
            _differs({**answer, "id": answer.get("id", request["id"])}, _next_answer(peer))
            for request, answer in zip(requests, _listed(step["answer"]), strict=True)
        ]
        if not any(reasons):
            return
        if not step.get("again") or time.monotonic() > deadline_s:
            raise UnexpectedError("; ".join(filter(None, reasons)))


def _send(stage: Stage, step: Step) -> None:
    """`send_vectors`: names of vectors; each is sent and must be answered by `answer`."""
    for name in step["send_vectors"]:
        stage.connected().socket.send((VECTORS / f"{name}.bytes").read_bytes())
        if reason := _differs(step["answer"], _next_answer(stage.connected())):
            raise UnexpectedError(f"{name}: {reason}")


def _send_parts(stage: Stage, step: Step) -> None:
    """`send_parts`: the parts of one message, in hexadecimal; it must be answered by `answer`."""
    parts = [bytes.fromhex(part) for part in step["send_parts"]]
    stage.connected().socket.send_multipart(parts)
    if reason := _differs(step["answer"], _next_answer(stage.connected())):
        raise UnexpectedError(reason)


def _pulses(stage: Stage, step: Step) -> None:
    """`pulses`: so many come unasked `within_s` seconds."""
    seen = (fields for fields in stage.connected().messages(step["within_s"]))
    count = sum(fields["kind"] == "pulse" for fields in seen)
    if count < step["pulses"]:
        raise UnexpectedError(f"{count} pulses came in {step['within_s']} s")


def _silence(stage: Stage, step: Step) -> None:
    """`silence_for_s`: nothing but pulses comes for so long."""
    for fields in stage.connected().answers(step["silence_for_s"]):
        raise UnexpectedError(f"{_shown(fields)} was not to come")


def _close(stage: Stage, step: Step) -> None:
    """`close`: end the connection; the next step makes another."""
    stage.connected().socket.close()
    stage.peer = None


def _next_answer(peer: Peer) -> Fields:
    for fields in peer.answers():
        return fields
    raise UnexpectedError(f"no answer came within {WITHIN_S:g} s")


def _request(stage: Stage, fields: Fields) -> Fields:
    request = {"id": next(stage.connected().ids), **fields}
    if request["kind"] == "ask_spawn":
        request = {**_place(stage.words), "name": None, **request}
    return request


def _place(words: dict[str, str]) -> Fields:
    """Return what the words say of a robot: its class, and its place as blocks of INIT."""
    blocks = parse_message(Template("INIT $place").substitute(words))
    location, rotation = blocks.get("Location"), blocks.get("Rotation")
    return {
        "class_name": words["class"],
        "location_m": None if location is None else list(vector_from_text(location)),
        "rotation_rad": [0.0, 0.0, 0.0] if rotation is None else list(vector_from_text(rotation)),
        "start": blocks.get("Start"),
    }


def _differs(expected: object, actual: object, path: str = "") -> str:
    """Return how a value departs from what is expected; empty if it does not."""
    if isinstance(expected, dict) and isinstance(actual, dict):
        found = (_field_differs(expected[key], actual, key, path) for key in expected)
        return next(filter(None, found), "")
    if isinstance(expected, list) and isinstance(actual, list):
        rest = iter(actual)
        lost = [one for one in expected if all(_differs(one, other) for other in rest)]
        return f"{path[1:]}: nothing like {lost[0]!r}" if lost else ""
    if isinstance(expected, str) and isinstance(actual, str):
        is_so = bool(re.fullmatch(expected, actual, re.DOTALL))
    else:
        is_so = expected == actual
    return "" if is_so else f"{path[1:]} {_shown(actual)}, not {expected!r}"


def _field_differs(expected: object, actual: Fields, key: str, path: str) -> str:
    if key not in actual:
        return f"{path[1:]} without the field {key!r}"
    reason = _differs(expected, actual[key], f"{path}.{key}")
    return f"{reason}: {actual['reason']}" if reason and "reason" in actual else reason


def _listed(value: Any) -> list[Any]:
    return value if isinstance(value, list) else [value]


def _shown(value: object) -> str:
    return repr(value)[:100]


STEPS: dict[str, Callable[[Stage, Step], None]] = {
    "ask": _ask,
    "send_vectors": _send,
    "send_parts": _send_parts,
    "pulses": _pulses,
    "silence_for_s": _silence,
    "close": _close,
}
SETTINGS = {"answer", "again", "within_s"}
