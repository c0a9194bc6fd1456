"""Parts of mutations of the stream: changes of the fields and the image of one message."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np

from conformance.mutation import ConnectionMutation, MutateBytes
from conformance.stream_zmtp import is_command, message_from_parts, parts_from_message

Fields = dict[str, Any]  # Any: every value of msgpack
# Fields and parts behind them in, the same out; None drops the message.
ChangeMessage = Callable[[Fields, list[bytes]], "tuple[Fields, list[bytes]] | None"]
Connect = Callable[[], ConnectionMutation]


def of_messages(change: ChangeMessage) -> Connect:
    """Mutation of the server's messages."""
    return lambda: ConnectionMutation(mutate_reply=_on_bytes(change))


def of_messages_with_state(make_change: Callable[[], ChangeMessage]) -> Connect:
    """Mutation of the server's messages that remembers earlier ones of the connection."""
    return lambda: ConnectionMutation(mutate_reply=_on_bytes(make_change()))


def of_kind(kind: str, change: ChangeMessage) -> ChangeMessage:
    """Change of the messages of one kind; the others pass."""
    return lambda fields, parts: (
        change(fields, parts) if fields["kind"] == kind else (fields, parts)
    )


def set_field(name: str, change: Callable[[Any], Any]) -> ChangeMessage:
    """Change of the value of a field, where it is there."""

    def change_message(fields: Fields, parts: list[bytes]) -> tuple[Fields, list[bytes]]:
        if fields.get(name) is not None:
            fields[name] = change(fields[name])
        return fields, parts

    return change_message


def drop_field(name: str) -> ChangeMessage:
    """The message without a field."""
    return lambda fields, parts: ({k: v for k, v in fields.items() if k != name}, parts)


def set_model_field(name: str, change: Callable[[str], str | None]) -> ChangeMessage:
    """Change of a pair of the camera model; None drops it."""

    def change_pairs(pairs: dict[str, str]) -> dict[str, str]:
        changed = {**pairs, name: change(pairs[name])} if name in pairs else pairs
        return {key: value for key, value in changed.items() if value is not None}

    return set_field("camera_model", change_pairs)


def set_landmark(change: Callable[[Fields], Fields]) -> ChangeMessage:
    """Change of each landmark of a reply."""
    return of_kind(
        "landmarks", set_field("landmarks", lambda landmarks: [change(one) for one in landmarks])
    )


def freeze_field(name: str) -> Callable[[], ChangeMessage]:
    """The first value of a frame's field in the place of all later ones."""

    def make_change() -> ChangeMessage:
        first: list[Any] = []

        def keep_first(value: Any) -> Any:
            first.append(value)
            return first[0]

        return of_kind("frame", set_field(name, keep_first))

    return make_change


def set_raw_picture(change: Callable[[Any], Any]) -> ChangeMessage:
    """Change of the (h, w, 3) array of a raw frame; frames of other encodings pass."""

    def change_message(fields: Fields, parts: list[bytes]) -> tuple[Fields, list[bytes]]:
        if fields["kind"] != "frame" or fields["encoding"] != "raw":
            return fields, parts
        shape = fields["height_px"], fields["width_px"], 3
        picture = np.frombuffer(parts[0], np.uint8).reshape(shape)
        return fields, [np.ascontiguousarray(change(picture)).tobytes()]

    return change_message


def repeat_first_image() -> ChangeMessage:
    """The first image of each encoding in all frames, with the fields of the present."""
    first: dict[str, bytes] = {}

    def change_message(fields: Fields, parts: list[bytes]) -> tuple[Fields, list[bytes]]:
        if fields["kind"] != "frame":
            return fields, parts
        return fields, [first.setdefault(fields["encoding"], parts[0])]

    return change_message


def _on_bytes(change: ChangeMessage) -> MutateBytes:
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
