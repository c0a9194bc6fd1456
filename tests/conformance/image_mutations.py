"""Mutations of the image port, and what notices each of them.

A frame is a type byte, a length and a payload; pictures are changed in the payload of JPEG frames
by decoding and encoding them again.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

import cv2
import numpy as np
import numpy.typing as npt

from conformance.mutation import ConnectionMutation, MutateBytes, Mutation

Pixels = npt.NDArray[np.uint8]
Connect = Callable[[], ConnectionMutation]

_HEADER = struct.Struct(">BI")
_REGION = struct.Struct(">c4I")
_JPEG_END = b"\xff\xd9"
# Begins the header of the compressed pixels of a JPEG; its length follows.
_JPEG_SCAN = b"\xff\xda"
_QUALITY = 75


def _mutation(name: str, connect: Connect, *noticed_by: str) -> Mutation:
    return Mutation(name, "image", connect, noticed_by)


def _of_frames(change: MutateBytes) -> Connect:
    return lambda: ConnectionMutation(mutate_reply=change)


def _of_payloads(change: MutateBytes) -> Connect:
    """Mutation of the payload; the length follows it."""

    def mutate(frame: bytes) -> bytes:
        payload = change(frame[_HEADER.size :])
        return _HEADER.pack(frame[0], len(payload)) + payload

    return _of_frames(mutate)


def _of_pictures(change: Callable[[Pixels], Pixels]) -> Connect:
    """Mutation of the decoded picture of a JPEG."""

    def mutate(payload: bytes) -> bytes:
        picture = cv2.imdecode(np.frombuffer(payload, np.uint8), cv2.IMREAD_COLOR)
        changed = np.ascontiguousarray(change(np.asarray(picture, np.uint8)))
        encoded: bytes = cv2.imencode(".jpg", changed, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[
            1
        ].tobytes()
        return encoded

    return _of_payloads(mutate)


def _of_requests(change: MutateBytes) -> Connect:
    return lambda: ConnectionMutation(mutate_request=change)


def _repeat_first_frame() -> ConnectionMutation:
    first: list[bytes] = []

    def mutate(frame: bytes) -> bytes:
        first.append(frame)
        return first[0]

    return ConnectionMutation(mutate_reply=mutate)


def _delay_by_one_frame() -> ConnectionMutation:
    last: list[bytes] = []

    def mutate(frame: bytes) -> bytes:
        last.append(frame)
        return last[-2] if len(last) > 1 else frame

    return ConnectionMutation(mutate_reply=mutate)


def _zero_body(payload: bytes) -> bytes:
    """Compressed pixels of zeros between the headers and the end."""
    scan = payload.index(_JPEG_SCAN)
    start = scan + 2 + int.from_bytes(payload[scan + 2 : scan + 4], "big")
    return payload[:start] + bytes(len(payload) - start - 2) + payload[-2:]


def _shift_region(request: bytes) -> bytes:
    if request[:1] != b"U":
        return request
    word, x, *rest = _REGION.unpack(request)
    return _REGION.pack(word, (x + 9) % 2**32, *rest)


def _with_type(type_: int) -> MutateBytes:
    return lambda frame: bytes([type_]) + frame[1:]


def _swap_length(frame: bytes) -> bytes:
    return frame[:1] + frame[4:0:-1] + frame[5:]


def _scale(factor: float) -> Callable[[Pixels], Pixels]:
    return lambda picture: np.asarray(cv2.resize(picture, None, fx=factor, fy=factor), np.uint8)


IMAGE_MUTATIONS: tuple[Mutation, ...] = (
    _mutation("unasked frame", _of_frames(lambda frame: frame + frame), "image_full_frame"),
    _mutation("little-endian length", _of_frames(_swap_length), "image_full_frame"),
    _mutation("type 9", _of_frames(_with_type(9)), "image_full_frame"),
    _mutation("doubled frame", _of_frames(lambda frame: frame + frame), "image_pipelined_requests"),
    _mutation("stale frame", _repeat_first_frame, "image_turn"),
    _mutation("frame of the request before", _delay_by_one_frame, "image_turn"),
    _mutation("doubled size", _of_pictures(_scale(2.0)), "image_region"),
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
    _mutation("picture black", _of_pictures(np.zeros_like), "image_picture"),
    _mutation("upside down", _of_pictures(lambda picture: picture[::-1]), "image_turn"),
    _mutation("mirrored", _of_pictures(lambda picture: picture[:, ::-1]), "image_turn"),
    _mutation(
        "rotated by half a turn",
        _of_pictures(lambda picture: picture[::-1, ::-1]),
        "image_stream_picture",
    ),
    _mutation(
        "R and B swapped on the image port",
        _of_pictures(lambda picture: picture[..., ::-1]),
        "image_stream_picture",
    ),
    _mutation("U rectangle 9 px off", _of_requests(_shift_region), "image_region_content"),
)
