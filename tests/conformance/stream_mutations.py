"""Mutations of the form of the stream's messages, played live, and what notices each of them.

Those of the fields are generated, and played against recordings: stream_message_mutations.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgpack

from conformance.mutation import ConnectionMutation, MutateBytes, Mutation
from conformance.stream_zmtp import is_command, message_from_parts, parts_from_message

Fields = dict[str, Any]  # Any: every value of msgpack
# Fields and parts behind them in, the same out; None drops the message.
_ChangeMessage = Callable[[Fields, list[bytes]], "tuple[Fields, list[bytes]] | None"]


def _of_kind(name: str, kind: str, change: _ChangeMessage, noticed_by: str) -> Mutation:
    """Mutation of the server's messages of one kind; the others pass."""

    def change_kind(fields: Fields, parts: list[bytes]) -> tuple[Fields, list[bytes]] | None:
        return change(fields, parts) if fields["kind"] == kind else (fields, parts)

    def connect() -> ConnectionMutation:
        return ConnectionMutation(mutate_reply=_on_bytes(change_kind))

    return Mutation(name, "stream", connect, (noticed_by,))


def _set(**values: object) -> _ChangeMessage:
    return lambda fields, parts: ({**fields, **values}, parts)


def _on_bytes(change: _ChangeMessage) -> MutateBytes:
    def mutate(message: bytes) -> bytes:
        # The greeting and commands of ZMTP are not ours: a message of ours is a map of msgpack.
        parts = [] if is_command(message) else parts_from_message(message)
        if not parts or not parts[0] or not _is_map(parts[0]):
            return message
        changed = change(msgpack.unpackb(parts[0]), parts[1:])
        if changed is None:
            return b""
        fields, rest = changed
        return message_from_parts([msgpack.packb(fields), *rest])

    return mutate


def _is_map(data: bytes) -> bool:
    """Whether bytes begin like a map of msgpack."""
    return data[0] & 0xF0 == 0x80 or data[0] in (0xDE, 0xDF)


STREAM_MUTATIONS: tuple[Mutation, ...] = (
    _of_kind("no pulse", "heartbeat", lambda *_: None, "stream_heartbeats"),
    _of_kind(
        "short picture",
        "frame",
        lambda fields, parts: (fields, [parts[0][:-3]]),
        "stream_frame_raw",
    ),
    _of_kind("mislabelled picture", "frame", _set(encoding="png"), "stream_frame_raw"),
    _of_kind("constant sequence", "frame", _set(sequence=1), "stream_frame_raw"),
    _of_kind("version 2", "frame", _set(version=2), "stream_frame_raw"),
    _of_kind("wrong id", "status", _set(id=2**40), "stream_status"),
)
