"""Fuzz targets of the stream, ZeroMQ's and a page's: both directions, frames and their labels."""

from __future__ import annotations

import json
import math
import random
import zlib
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import cv2
import msgpack
import numpy as np

from catoptra_client.frame import rgb_from_image_bytes
from catoptra_client.frame_sources.stream.frame_decoding import CameraModelCache, frame_from_parts
from catoptra_protocol.camera_conf import omni_camera_from_pairs, pairs_from_omni_camera
from catoptra_protocol.errors import DomainError, LocalProtocolError, RemoteProtocolError
from catoptra_protocol.labels import LABEL_CHANNELS, parse_channels
from catoptra_protocol.stream.codec import MAX_REPLY_BYTES, unpack
from catoptra_protocol.stream.messages import (
    bytes_from_message,
    json_from_message,
    reply_from_bytes,
    reply_from_json,
    request_from_bytes,
    request_from_json,
)
from catoptra_protocol.stream.replies import FrameHeader
from catoptra_protocol.usarsim.grammar import parse_message
from catoptra_server.serve.web.page_socket import MaskCheck
from conformance.fuzz_target import DATA, FeedInput, FuzzTarget, check, mutate

_HYPERBOLIC_CONF = (
    b"CONF {Type Camera} {Name OmniCam} {Width 360} {Height 360} {Mirror hyperbolic} "
    b"{MirrorK 11.546} {MirrorC 2.321} {CentreU 180.0} {CentreV 180.0} {HorizonRadius 93.1} "
    b"{RimAngle 125.0} {UpAzimuth 0.0} {Picture mirrored} {ViewpointHeight 0.55}"
)
_PARABOLIC_CONF = _HYPERBOLIC_CONF.replace(b"hyperbolic", b"parabolic").replace(
    b"{MirrorK 11.546} {MirrorC 2.321}", b"{MirrorHorizonRadius 0.03}"
)
# Values that no valid message has in any field.
_ODD_VALUES: tuple[Any, ...] = (
    *(None, True, 0, -1, 2**63, 2**64 - 1, 1.5, math.nan, -math.inf, 1e308, "", "raw", "x" * 300),
    *(b"", b"\xff", [], [1], [1.0, 2.0, 3.0], [None] * 3, [0.0] * 9, {}, {"position_m": []}),
    *({"": ""}, {"a": {"a": {}}}, "\0\ud7ff", "unknown", msgpack.ExtType(1, b"")),
)


def stream_targets() -> list[FuzzTarget]:
    """The parsers."""
    requests, replies = _load_messages("client"), _load_messages("server")
    frames = tuple(
        _frame_seeds(*(_read_vector(f"frame{suffix}") for suffix in ("", "_with_labels")))
    )
    channels = b",".join(name.encode() for name in LABEL_CHANNELS)
    images = tuple(_encoded_images().values())
    return [
        FuzzTarget("unpack", _feed_msgpack, (*requests, *replies), mutate_message),
        FuzzTarget("request_from_bytes", _feed_request, requests, mutate_message),
        FuzzTarget("reply_from_bytes", _feed_reply, replies, mutate_message),
        FuzzTarget("request_from_json", _feed_json_request, requests, mutate_json_message),
        FuzzTarget("reply_from_json", _feed_json_reply, replies, mutate_json_message),
        FuzzTarget("frame_from_parts", _make_frame_feeder(), frames),
        FuzzTarget("labels of a frame", _make_frame_feeder(), frames[-1:], mutate_labels),
        FuzzTarget("parse_channels", _feed_channels, (b"range", channels)),
        FuzzTarget("MaskCheck", _feed_masked, tuple(map(_page_message, requests))),
        FuzzTarget("rgb_from_image_bytes", _feed_image, images, period=5),
        FuzzTarget("omni_camera_from_pairs", _feed_camera, (_HYPERBOLIC_CONF, _PARABOLIC_CONF)),
    ]


def _read_vector(name: str) -> bytes:
    return (DATA / f"stream/{name}.bytes").read_bytes()


def _load_messages(sender: str) -> tuple[bytes, ...]:
    """Vectors that a `client` or a `server` sends."""
    documents = sorted((DATA / "stream").glob("*.json"))
    return tuple(
        path.with_suffix(".bytes").read_bytes()
        for path in documents
        if json.loads(path.read_text(encoding="utf-8"))["sender"] == sender
    )


def mutate_message(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Message with one field changed, missing or added, or with changed bytes."""
    # Half of the inputs stay valid msgpack, so that the checks of fields are reached.
    if rng.random() < 0.5:
        return mutate(rng, seeds)
    data: bytes = msgpack.packb(_mutate_fields(rng, seeds))
    return data


def mutate_json_message(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """As `mutate_message`, in JSON."""
    # Python writes NaN and Infinity, as a careless peer does.
    text = json.dumps(_mutate_fields(rng, seeds), default=repr).encode()
    return mutate(rng, [text]) if rng.random() < 0.5 else text


def _mutate_fields(rng: random.Random, seeds: Sequence[bytes]) -> dict[str, Any]:
    """Fields of a message, one of them changed, missing or added."""
    fields = _fields_from_vector(rng.choice(seeds))
    inner = [value for value in fields.values() if isinstance(value, dict) and value]
    target = rng.choice([fields, *inner])
    match rng.randrange(4):
        case 0:
            target.pop(rng.choice(list(target)))
        case 1:
            target[rng.choice(list(target)) + "_"] = rng.choice(_ODD_VALUES)
        case _:
            target[rng.choice(list(target))] = rng.choice(_ODD_VALUES)
    return fields


def mutate_labels(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """Frame with one value changed or missing anywhere in its labels, or with changed bytes."""
    data = rng.choice(seeds)
    end = 2 + int.from_bytes(data[:2])
    if rng.random() < 0.25:
        return data[:end] + mutate(rng, [data[end:]])
    fields = msgpack.unpackb(data[2:end])
    inner, key = fields, "labels"
    while isinstance(inner[key], dict | list) and inner[key] and rng.random() < 0.9:
        inner = inner[key]
        key = rng.choice(list(inner) if isinstance(inner, dict) else range(len(inner)))
    if rng.random() < 0.25:
        del inner[key]
    else:
        inner[key] = rng.choice(_ODD_VALUES)
    header = msgpack.packb(fields)
    return len(header).to_bytes(2) + header + data[end:]


def _fields_from_vector(data: bytes) -> dict[str, Any]:
    """Fields of a vector; those of a status request for a vector that is no map."""
    try:
        fields = msgpack.unpackb(data)
    except ValueError:
        fields = None
    return fields if isinstance(fields, dict) else {"kind": "get_status", "id": 1}


def _feed_msgpack(data: bytes) -> bool:
    try:
        return isinstance(unpack(data, MAX_REPLY_BYTES), dict)
    except RemoteProtocolError:
        return False


def _feed_request(data: bytes) -> bool:
    """Decode a request; encoded and decoded again, the request must be the same."""
    try:
        request = request_from_bytes(data)
    except RemoteProtocolError:
        return False
    check(request_from_bytes(bytes_from_message(request)) == request, "a request that changes")
    return True


def _feed_reply(data: bytes) -> bool:
    """Decode a reply; encoded and decoded again, the reply must be the same."""
    try:
        reply = reply_from_bytes(data)
    except RemoteProtocolError:
        return False
    if reply is not None:
        str(reply)
        check(reply_from_bytes(bytes_from_message(reply)) == reply, "a reply that changes")
    return reply is not None


def _feed_json_request(data: bytes) -> bool:
    try:
        request = request_from_json(data.decode(errors="surrogateescape"))
    except RemoteProtocolError:
        return False
    check(request_from_json(json_from_message(request)) == request, "a request that changes")
    check(request_from_bytes(bytes_from_message(request)) == request, "a request of no bytes")
    return True


def _feed_json_reply(data: bytes) -> bool:
    try:
        reply = reply_from_json(data.decode(errors="surrogateescape"))
    except RemoteProtocolError:
        return False
    if reply is not None:
        check(reply_from_json(json_from_message(reply)) == reply, "a reply that changes")
    return reply is not None


def _page_message(request: bytes) -> bytes:
    """WebSocket frame of a request, masked with zeros (RFC 6455 5.2)."""
    text = json.dumps(_fields_from_vector(request), default=repr).encode()
    return b"\x81\xfe" + len(text).to_bytes(2) + bytes(4) + text


def _feed_masked(data: bytes) -> bool:
    """Check the masks of frames, whole and byte by byte."""
    whole, piecewise = MaskCheck(), MaskCheck()
    is_masked = whole.feed(data)
    again = all(piecewise.feed(data[index : index + 1]) for index in range(len(data)))
    check(is_masked == again, "a mask that depends on the reads")
    check(len(whole._head) <= 14, "more than the head of a frame is buffered")
    return is_masked


def _feed_channels(data: bytes) -> bool:
    try:
        return bool(parse_channels(tuple(data.decode("latin-1").split(","))))
    except DomainError:
        return False


def _make_frame_feeder() -> FeedInput:
    """Feeder of a header and an image, with one camera cache for all frames as in a client."""
    camera_cache = CameraModelCache()

    def feed(data: bytes) -> bool:
        length = int.from_bytes(data[:2])
        try:
            header = reply_from_bytes(data[2 : 2 + length])
            if not isinstance(header, FrameHeader):
                return False
            parts = _split_parts(header, data[2 + length :])
            frame = frame_from_parts(header, parts, camera_cache=camera_cache, received_s=0.0)
        except RemoteProtocolError:
            return False
        # The picture and its difference from a reference share an image.
        width_px = header.width_px // (1 if header.difference is None else 2)
        check(frame.rgb.shape == (header.height_px, width_px, 3), "another size")
        for channel in (frame.labels.truth.channels if frame.labels else {}).values():
            check(
                channel.shape[:2] == (header.height_px, header.width_px), "labels of another size"
            )
        return True

    return feed


def _split_parts(header: FrameHeader, data: bytes) -> list[bytes]:
    """The image, and the channels of labels behind it."""
    sizes = [channel.num_bytes for channel in header.labels.channels] if header.labels else []
    begins = [max(0, len(data) - sum(sizes[index:])) for index in range(len(sizes) + 1)]
    return [data[begin:end] for begin, end in pairwise([0, *begins])]


def _frame_seeds(header: bytes, labelled_header: bytes) -> list[bytes]:
    """A frame of each encoding: length of the header, the header, the image; one with labels."""
    seeds = []
    # Every other channel is compressed.
    arrays = [np.ones(one.shape(6, 8), one.dtype).tobytes() for one in LABEL_CHANNELS.values()]
    parts = [zlib.compress(array) if odd % 2 else array for odd, array in enumerate(arrays)]
    camera_model = dict(parse_message(_PARABOLIC_CONF.decode()).pairs[2:])
    for encoding, image in _encoded_images().items():
        fields = msgpack.unpackb(header)
        fields |= {"encoding": encoding, "width_px": 8, "height_px": 6}
        fields["camera_model"] = camera_model
        data = msgpack.packb(fields)
        seeds.append(len(data).to_bytes(2) + data + image)
    fields |= {"labels": msgpack.unpackb(labelled_header)["labels"]}
    fields["labels"]["channels"] = [
        {
            **{"name": one.name, "dtype": one.dtype, "depth": one.depth, "num_bytes": len(part)},
            "encoding": "zlib" if odd % 2 else "raw",
        }
        for odd, (one, part) in enumerate(zip(LABEL_CHANNELS.values(), parts, strict=True))
    ]
    data = msgpack.packb(fields)
    return [*seeds, len(data).to_bytes(2) + data + image + b"".join(parts)]


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
    """Parse the pairs of a CONF line; formatted again, the pairs must be valid."""
    pairs = parse_message(data.decode("latin-1")).pairs
    try:
        camera, height_m = omni_camera_from_pairs(pairs)
        omni_camera_from_pairs(pairs_from_omni_camera(camera, height_m))
    except (RemoteProtocolError, LocalProtocolError):
        return False
    return True
