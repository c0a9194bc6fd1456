"""Recordings as rosbags reads them."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader


def read_bag(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Messages of each topic with their stamps, by rosbags alone."""
    found = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, stamp_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found[connection.topic].append((stamp_ns, message))
    return found
