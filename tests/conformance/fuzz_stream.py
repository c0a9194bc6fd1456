"""The parsers of the modern stream, both directions, and what a client makes of a frame."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import Any

import cv2
import msgpack
import numpy as np

from catoptra_client.frame import rgb_from_file
from catoptra_client.stream_frame import CameraLaws, frame_from_parts
from catoptra_protocol.camera_conf import camera_from_pairs, pairs_from_camera
from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.wire.envelope import MAX_ANSWER_BYTES, unpacked
from catoptra_protocol.wire.grammar import parse_message
from catoptra_protocol.wire.stream import (
    answer_from_bytes,
    bytes_from_message,
    request_from_bytes,
)
from catoptra_protocol.wire.stream_answers import FrameHeader
from conformance.fuzz_parser import DATA, Case, Parser, hold, mutated

_CAMERA_LAW = (
    b"CONF {Type Camera} {Name OmniCam} {Width 360} {Height 360} {Mirror hyperbolic} "
    b"{MirrorK 11.546} {MirrorC 2.321} {CentreU 180.0} {CentreV 180.0} {HorizonRadius 93.1} "
    b"{RimAngle 125.0} {UpAzimuth 0.0} {ViewpointHeight 0.55}"
)
_PARABOLA = _CAMERA_LAW.replace(b"hyperbolic", b"parabolic").replace(
    b"{MirrorK 11.546} {MirrorC 2.321}", b"{MirrorHorizonRadius 0.03}"
)
# What a field may hold that no message of ours does.
_STRANGE: tuple[Any, ...] = (
    *(None, True, 0, -1, 2**63, 2**64 - 1, 1.5, math.nan, -math.inf, 1e308, "", "raw", "x" * 300),
    *(b"", b"\xff", [], [1], [1.0, 2.0, 3.0], [None] * 3, [0.0] * 9, {}, {"position_m": []}),
    *({"": ""}, {"a": {"a": {}}}, "\0\ud7ff", "ask_fly", msgpack.ExtType(1, b"")),
)


def parsers() -> list[Parser]:
    """Return the parsers."""
    vectors = {path.stem: path.read_bytes() for path in sorted((DATA / "stream").glob("*.bytes"))}
    requests = tuple(data for name, data in vectors.items() if name.startswith("ask_"))
    answers = tuple(data for name, data in vectors.items() if not name.startswith("ask_"))
    return [
        Parser("envelope", _envelope, tuple(vectors.values()), mutated_message),
        Parser("request_from_bytes", _request, requests, mutated_message),
        Parser("answer_from_bytes", _answer, answers, mutated_message),
        Parser("frame_from_parts", _frame(), tuple(_frames(vectors["frame"]))),
        Parser("rgb_from_file", _picture, tuple(_pictures().values()), every=5),
        Parser("camera_from_pairs", _camera, (_CAMERA_LAW, _PARABOLA)),
    ]


def mutated_message(chance: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Return a message with one field changed, lost or added, or with bytes changed."""
    if chance.random() < 0.5:
        return mutated(chance, seeds)
    fields = _fields_of(chance.choice(seeds))
    inner = [value for value in fields.values() if isinstance(value, dict) and value]
    place = chance.choice([fields, *inner])
    match chance.randrange(4):
        case 0:
            place.pop(chance.choice(list(place)))
        case 1:
            place[chance.choice(list(place)) + "_"] = chance.choice(_STRANGE)
        case _:
            place[chance.choice(list(place))] = chance.choice(_STRANGE)
    data: bytes = msgpack.packb(fields)
    return data


def _fields_of(data: bytes) -> dict[str, Any]:
    """Return the fields of a vector; of one that is no map, those of a status."""
    try:
        fields = msgpack.unpackb(data)
    except ValueError:
        fields = None
    return fields if isinstance(fields, dict) else {"kind": "ask_status", "id": 1}


def _envelope(data: bytes) -> bool:
    try:
        return isinstance(unpacked(data, MAX_ANSWER_BYTES), dict)
    except RemoteProtocolError:
        return False


def _request(data: bytes) -> bool:
    """Read a request; written and read again it is the same."""
    try:
        request = request_from_bytes(data)
    except RemoteProtocolError:
        return False
    hold(request_from_bytes(bytes_from_message(request)) == request, "a request that changes")
    return True


def _answer(data: bytes) -> bool:
    """Read an answer; written and read again it is the same."""
    try:
        answer = answer_from_bytes(data)
    except RemoteProtocolError:
        return False
    if answer is not None:
        str(answer)
        hold(answer_from_bytes(bytes_from_message(answer)) == answer, "an answer that changes")
    return answer is not None


def _frame() -> Case:
    """Feed a header and a picture with the lengths before them, as a client that keeps laws."""
    laws = CameraLaws()

    def feed(data: bytes) -> bool:
        length = int.from_bytes(data[:2])
        try:
            header = answer_from_bytes(data[2 : 2 + length])
            if not isinstance(header, FrameHeader):
                return False
            picture = data[2 + length :]
            frame = frame_from_parts(header, [picture], laws=laws, received_s=0.0)
        except RemoteProtocolError:
            return False
        hold(frame.rgb.shape == (header.height_px, header.width_px, 3), "another size")
        return True

    return feed


def _frames(header: bytes) -> list[bytes]:
    """Return a frame of each encoding: the header's length, the header, the picture."""
    found = []
    law = dict(parse_message(_PARABOLA.decode()).pairs[2:])
    for encoding, picture in _pictures().items():
        fields = msgpack.unpackb(header)
        fields |= {"encoding": encoding, "width_px": 8, "height_px": 6, "camera_law": law}
        data = msgpack.packb(fields)
        found.append(len(data).to_bytes(2) + data + picture)
    return found


def _pictures() -> dict[str, bytes]:
    rgb = np.arange(8 * 6 * 3, dtype=np.uint8).reshape(6, 8, 3)
    files = {kind: cv2.imencode(f".{kind}", rgb)[1].tobytes() for kind in ("jpeg", "png")}
    return {"raw": rgb.tobytes(), **files}


def _picture(data: bytes) -> bool:
    try:
        rgb = rgb_from_file(data)
    except RemoteProtocolError:
        return False
    return rgb.ndim == 3


def _camera(data: bytes) -> bool:
    """Read a law from the pairs of a CONF line; written and read again it is one, too."""
    pairs = parse_message(data.decode("latin-1")).pairs
    try:
        camera, height_m = camera_from_pairs(pairs)
        camera_from_pairs(pairs_from_camera(camera, height_m))
    except (RemoteProtocolError, LocalProtocolError):
        return False
    return True
