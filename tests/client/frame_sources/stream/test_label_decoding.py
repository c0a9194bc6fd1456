"""Labels of a server that sends something else than its header says."""

from __future__ import annotations

import zlib
from dataclasses import replace

import numpy as np
import pytest

from catoptra_client.frame_sources.stream.stream_client import labels_from_parts
from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.stream.requests import (
    ChannelEncoding,
    ChannelRecord,
    LabelsRecord,
    ObjectRecord,
    Transform,
)

IDS = np.arange(6, dtype="<u2").reshape(2, 3)
RECORD = ChannelRecord("ids", "<u2", 1, ChannelEncoding.RAW, 12)
UPRIGHT = Transform((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))


def test_channels_and_objects_are_decoded() -> None:
    crate = ObjectRecord(3, "crate", "object", 2, UPRIGHT, (0.5, 0.25, 0.125))
    packed = replace(RECORD, encoding=ChannelEncoding.ZLIB)
    for record, part in ((RECORD, IDS.tobytes()), (packed, zlib.compress(IDS.tobytes()))):
        found = labels_from_parts(LabelsRecord((record,), (crate,)), [part], (2, 3))
        np.testing.assert_array_equal(found.truth.channels["ids"], IDS)
        (one,) = found.truth.objects
        np.testing.assert_allclose(one.corners().mean(axis=0), (1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("record", "part", "size", "message"),
    [
        (RECORD, IDS.tobytes()[:-1], (2, 3), "11 bytes, expected 12"),
        (replace(RECORD, dtype="<f4"), IDS.tobytes(), (2, 3), "no such channel"),
        (replace(RECORD, name="smell"), IDS.tobytes(), (2, 3), "no such channel"),
        (RECORD, b"", (-2, -3), "-3 x -2 px"),
        (RECORD, b"", (2**20, 2**20), "1048576 x 1048576 px"),
        (replace(RECORD, encoding=ChannelEncoding.ZLIB), b"no zlib", (2, 3), "header"),
    ],
)
def test_parts_that_do_not_match_are_errors(
    record: ChannelRecord, part: bytes, size: tuple[int, int], message: str
) -> None:
    with pytest.raises(RemoteProtocolError, match=message):
        labels_from_parts(LabelsRecord((record,)), [part], size)


def test_swelling_part_is_not_inflated() -> None:
    bomb = zlib.compress(bytes(50_000_000), 9)
    packed = replace(RECORD, encoding=ChannelEncoding.ZLIB)
    with pytest.raises(RemoteProtocolError, match="13 bytes, expected 12"):
        labels_from_parts(LabelsRecord((packed,)), [bomb], (2, 3))
