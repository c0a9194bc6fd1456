"""Recordings as rosbags reads them."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader


def read_bag(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Messages of each topic with their stamps, by rosbags alone."""
    found = defaultdict(list)
    with AnyReader([path]) as reader:
        for connection, stamp_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            found[connection.topic].append((stamp_ns, message))
    return found


def matrix_of(transform: Any) -> Any:
    """Matrix (4, 4) of a geometry_msgs/Transform."""
    q, place = transform.rotation, transform.translation
    x, y, z, w = q.x, q.y, q.z, q.w
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), place.x],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), place.y],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), place.z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )
