"""The parsers of the modern stream, both directions, and what a client makes of a frame."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import Any

import cv2
import msgpack
import numpy as np

from catoptra_client.frame import rgb_from_image_bytes
from catoptra_client.frame_sources.stream.frame_decoding import CameraModelCache, frame_from_parts
from catoptra_protocol.camera_conf import omni_camera_from_pairs, pairs_from_omni_camera
from catoptra_protocol.errors import LocalProtocolError, RemoteProtocolError
from catoptra_protocol.stream.messages import (
    bytes_from_message,
    reply_from_bytes,
    request_from_bytes,
)
from catoptra_protocol.stream.msgpack_codec import MAX_REPLY_BYTES, unpack
from catoptra_protocol.stream.replies import FrameHeader
from catoptra_protocol.usarsim.grammar import parse_message
from conformance.fuzz_target import DATA, FeedInput, FuzzTarget, check, mutate

_HYPERBOLIC_CONF = (
    b"CONF {Type Camera} {Name OmniCam} {Width 360} {Height 360} {Mirror hyperbolic} "
    b"{MirrorK 11.546} {MirrorC 2.321} {CentreU 180.0} {CentreV 180.0} {HorizonRadius 93.1} "
    b"{RimAngle 125.0} {UpAzimuth 0.0} {ViewpointHeight 0.55}"
)
_PARABOLIC_CONF = _HYPERBOLIC_CONF.replace(b"hyperbolic", b"parabolic").replace(
    b"{MirrorK 11.546} {MirrorC 2.321}", b"{MirrorHorizonRadius 0.03}"
)
# What a field may hold that no message of ours does.
_ODD_VALUES: tuple[Any, ...] = (
    *(None, True, 0, -1, 2**63, 2**64 - 1, 1.5, math.nan, -math.inf, 1e308, "", "raw", "x" * 300),
    *(b"", b"\xff", [], [1], [1.0, 2.0, 3.0], [None] * 3, [0.0] * 9, {}, {"position_m": []}),
    *({"": ""}, {"a": {"a": {}}}, "\0\ud7ff", "ask_fly", msgpack.ExtType(1, b"")),
)


def stream_targets() -> list[FuzzTarget]:
    """Return the parsers."""
    vectors = {path.stem: path.read_bytes() for path in sorted((DATA / "stream").glob("*.bytes"))}
    requests = tuple(data for name, data in vectors.items() if name.startswith("ask_"))
    answers = tuple(data for name, data in vectors.items() if not name.startswith("ask_"))
    return [
        FuzzTarget("envelope", _feed_msgpack, tuple(vectors.values()), mutate_message),
        FuzzTarget("request_from_bytes", _feed_request, requests, mutate_message),
        FuzzTarget("answer_from_bytes", _feed_reply, answers, mutate_message),
        FuzzTarget("frame_from_parts", _make_frame_feeder(), tuple(_frame_seeds(vectors["frame"]))),
        FuzzTarget("rgb_from_file", _feed_image, tuple(_encoded_images().values()), period=5),
        FuzzTarget("camera_from_pairs", _feed_camera, (_HYPERBOLIC_CONF, _PARABOLIC_CONF)),
    ]


def mutate_message(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Return a message with one field changed, lost or added, or with bytes changed."""
    if rng.random() < 0.5:
        return mutate(rng, seeds)
    fields = _fields_from_vector(rng.choice(seeds))
    inner = [value for value in fields.values() if isinstance(value, dict) and value]
    place = rng.choice([fields, *inner])
    match rng.randrange(4):
        case 0:
            place.pop(rng.choice(list(place)))
        case 1:
            place[rng.choice(list(place)) + "_"] = rng.choice(_ODD_VALUES)
        case _:
            place[rng.choice(list(place))] = rng.choice(_ODD_VALUES)
    data: bytes = msgpack.packb(fields)
    return data


def _fields_from_vector(data: bytes) -> dict[str, Any]:
    """Return the fields of a vector; of one that is no map, those of a status."""
    try:
        fields = msgpack.unpackb(data)
    except ValueError:
        fields = None
    return fields if isinstance(fields, dict) else {"kind": "ask_status", "id": 1}


def _feed_msgpack(data: bytes) -> bool:
    try:
        return isinstance(unpack(data, MAX_REPLY_BYTES), dict)
    except RemoteProtocolError:
        return False


def _feed_request(data: bytes) -> bool:
    """Read a request; written and read again it is the same."""
    try:
        request = request_from_bytes(data)
    except RemoteProtocolError:
        return False
    check(request_from_bytes(bytes_from_message(request)) == request, "a request that changes")
    return True


def _feed_reply(data: bytes) -> bool:
    """Read an answer; written and read again it is the same."""
    try:
        answer = reply_from_bytes(data)
    except RemoteProtocolError:
        return False
    if answer is not None:
        str(answer)
        check(reply_from_bytes(bytes_from_message(answer)) == answer, "an answer that changes")
    return answer is not None


def _make_frame_feeder() -> FeedInput:
    """Feed a header and a picture with the lengths before them, as a client that keeps laws."""
    laws = CameraModelCache()

    def feed(data: bytes) -> bool:
        length = int.from_bytes(data[:2])
        try:
            header = reply_from_bytes(data[2 : 2 + length])
            if not isinstance(header, FrameHeader):
                return False
            picture = data[2 + length :]
            frame = frame_from_parts(header, [picture], camera_cache=laws, received_s=0.0)
        except RemoteProtocolError:
            return False
        check(frame.rgb.shape == (header.height_px, header.width_px, 3), "another size")
        return True

    return feed


def _frame_seeds(header: bytes) -> list[bytes]:
    """Return a frame of each encoding: the header's length, the header, the picture."""
    found = []
    law = dict(parse_message(_PARABOLIC_CONF.decode()).pairs[2:])
    for encoding, picture in _encoded_images().items():
        fields = msgpack.unpackb(header)
        fields |= {"encoding": encoding, "width_px": 8, "height_px": 6, "camera_law": law}
        data = msgpack.packb(fields)
        found.append(len(data).to_bytes(2) + data + picture)
    return found


def _encoded_images() -> dict[str, bytes]:
    rgb = np.arange(8 * 6 * 3, dtype=np.uint8).reshape(6, 8, 3)
    files = {kind: cv2.imencode(f".{kind}", rgb)[1].tobytes() for kind in ("jpeg", "png")}
    return {"raw": rgb.tobytes(), **files}


def _feed_image(data: bytes) -> bool:
    try:
        rgb = rgb_from_image_bytes(data)
    except RemoteProtocolError:
        return False
    return rgb.ndim == 3


def _feed_camera(data: bytes) -> bool:
    """Read a law from the pairs of a CONF line; written and read again it is one, too."""
    pairs = parse_message(data.decode("latin-1")).pairs
    try:
        camera, height_m = omni_camera_from_pairs(pairs)
        omni_camera_from_pairs(pairs_from_omni_camera(camera, height_m))
    except (RemoteProtocolError, LocalProtocolError):
        return False
    return True
