"""Mutations of the image port, and what notices each of them.

The numbers of a frame's header, of its picture's header and of a region request are fields, whose
mutations are generated, like those of the picture's values; pictures are decoded and encoded again.
The other mutations are of a server's behaviour.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator
from functools import partial

import cv2
import numpy as np
import numpy.typing as npt

from conformance.field_mutations import (
    CONSTANT,
    MEASURED,
    Fault,
    FieldMutation,
    NumericField,
    Quantity,
    generate_mutations,
)
from conformance.mutation import ConnectionMutation, MutateBytes, Mutation
from conformance.stream_message_mutations import ARRAY_CHANGES

Pixels = npt.NDArray[np.uint8]
Connect = Callable[[], ConnectionMutation]

_HEADER = struct.Struct(">BI")
_JPEG_END = b"\xff\xd9"
# Begins the header of the compressed pixels of a JPEG; its length follows.
_JPEG_SCAN = b"\xff\xda"
_QUALITY = 75

_FIELDS = {
    "frame": rb"(?s)^(?P<type>.)(?P<length>.{4})",
    "picture": rb"(?s)\xff[\xc0\xc2].{2}\x08(?P<height>..)(?P<width>..)",
    "region": rb"(?s)^\0*U(?P<x>.{4})(?P<y>.{4})(?P<width>.{4})(?P<height>.{4})$",
}
"""Big-endian numbers of each message: two of a server's and one of a client's."""
_NEIGHBOURS = {"x": "y", "y": "x", "width": "height", "height": "width", "length": "type"}
# Types of JPEG differ in quality alone.
_TYPE_FAULTS = (Fault.SIGN, Fault.TEN_TIMES, Fault.LARGER_UNIT_NUMBER, Fault.ABSENT)


def _mutation(name: str, connect: Connect, *noticed_by: str) -> Mutation:
    return Mutation(name, "image", connect, noticed_by)


def _generate_field_mutations() -> Iterator[Mutation]:
    for message, pattern in _FIELDS.items():
        for path in re.compile(pattern).groupindex:
            faults = MEASURED if message == "region" else CONSTANT
            faults = _TYPE_FAULTS if path == "type" else faults
            if message == "picture":
                # The picture of the tests is square.
                faults = tuple(one for one in faults if one is not Fault.EXCHANGED)
            field = NumericField(message, path, Quantity.COUNT, _NEIGHBOURS.get(path, ""), faults)
            is_place = path in ("x", "y")
            row = {"frame": "image_full_frame", "picture": "image_stream_picture"}.get(
                message, "image_region_content" if is_place else "image_region"
            )
            for one in generate_mutations({path: field}):
                yield _mutation(one.name, partial(_connect_field, one), row)


def _connect_field(mutation: FieldMutation) -> ConnectionMutation:
    pattern, change_numbers = re.compile(_FIELDS[mutation.field.message]), mutation.make_change()

    def mutate(data: bytes) -> bytes:
        found = pattern.search(data)
        if found is None:
            return data
        parts = {name: int.from_bytes(part) for name, part in found.groupdict().items()}
        numbers = change_numbers({name: (float(number),) for name, number in parts.items()})
        for name in reversed(pattern.groupindex):
            start, end = found.span(name)
            # To the next number, so that 10 % of a small one show.
            number = [np.ceil(x) for x in numbers.get(name, ())]
            text = b"".join((int(x) % 256 ** (end - start)).to_bytes(end - start) for x in number)
            data = data[:start] + text + data[end:]
        return data

    if mutation.field.message == "region":
        return ConnectionMutation(mutate_request=mutate)
    if mutation.field.message == "picture":
        return _of_payloads(mutate)()
    return ConnectionMutation(mutate_reply=mutate)


def _of_frames(change: MutateBytes) -> Connect:
    return lambda: ConnectionMutation(mutate_reply=change)


def _of_payloads(change: MutateBytes) -> Connect:
    """Mutation of the payload; the length follows it."""

    def mutate(frame: bytes) -> bytes:
        payload = change(frame[_HEADER.size :])
        return _HEADER.pack(frame[0], len(payload)) + payload

    return _of_frames(mutate)


def _of_pictures(change: Callable[[Pixels], npt.NDArray[np.number]]) -> Connect:
    """Mutation of the decoded picture of a JPEG."""

    def mutate(payload: bytes) -> bytes:
        picture = cv2.imdecode(np.frombuffer(payload, np.uint8), cv2.IMREAD_COLOR)
        changed = np.ascontiguousarray(change(np.asarray(picture, np.uint8)).astype(np.uint8))
        quality = [cv2.IMWRITE_JPEG_QUALITY, _QUALITY]
        encoded: bytes = cv2.imencode(".jpg", changed, quality)[1].tobytes()
        return encoded

    return _of_payloads(mutate)


def _of_requests(change: MutateBytes) -> Connect:
    return lambda: ConnectionMutation(mutate_request=change)


def _remember(index: Callable[[int], int]) -> Connect:
    """Mutation that sends an earlier frame, by the number of the newest one."""

    def connect() -> ConnectionMutation:
        frames: list[bytes] = []

        def mutate(frame: bytes) -> bytes:
            frames.append(frame)
            return frames[index(len(frames) - 1)]

        return ConnectionMutation(mutate_reply=mutate)

    return connect


def _zero_body(payload: bytes) -> bytes:
    """Compressed pixels of zeros between the headers and the end."""
    scan = payload.index(_JPEG_SCAN)
    start = scan + 2 + int.from_bytes(payload[scan + 2 : scan + 4], "big")
    return payload[:start] + bytes(len(payload) - start - 2) + payload[-2:]


def _double_size(picture: Pixels) -> Pixels:
    return np.asarray(cv2.resize(picture, None, fx=2.0, fy=2.0), np.uint8)


IMAGE_MUTATIONS: tuple[Mutation, ...] = (
    _mutation("doubled frame", _of_frames(lambda frame: frame + frame), "image_pipelined_requests"),
    # The first frame may show the time before the robot.
    _mutation("stale frame", _remember(lambda newest: min(newest, 1)), "image_turn"),
    _mutation(
        "frame of the request before", _remember(lambda newest: max(0, newest - 1)), "image_turn"
    ),
    _mutation("doubled size", _of_pictures(_double_size), "image_region"),
    _mutation(
        "U answered by the full frame",
        _of_requests(lambda data: b"OK" if data[:1] == b"U" else data),
        "image_region",
        "image_region_content",
    ),
    _mutation(
        "OKOK merged",
        _of_requests(lambda data: data.replace(b"OKOK", b"OK")),
        "image_pipelined_requests",
    ),
    _mutation(
        "JPEG cut off",
        _of_payloads(lambda payload: payload.removesuffix(_JPEG_END)),
        "image_picture",
    ),
    _mutation(
        "JPEG of half its bytes",
        _of_payloads(lambda payload: payload[: len(payload) // 2] + _JPEG_END),
        "image_stream_picture",
    ),
    _mutation("body zeroed", _of_payloads(_zero_body), "image_picture"),
    *_generate_field_mutations(),
    *(
        _mutation(f"picture {name}", _of_pictures(change), "image_stream_picture")
        for name, change in ARRAY_CHANGES.items()
    ),
)
