"""Boxes that stand anywhere, and where rays meet them: what robots are to each other's sensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.numerics import Bools, Floats

# Stands for a direction's component of 0: its slab is then crossed at +-1e200 times a length,
# behind every distance and still finite.
_LEVEL = 1e-200


class OrientedBox(NamedTuple):
    """A box of full edge lengths `size_m` (length, width, height), centred on its pose."""

    world_from_box: Pose
    size_m: tuple[float, float, float]


def box_distances(boxes: Sequence[OrientedBox], origins: Floats, directions: Floats) -> Floats:
    """Return (n,) metres along unit (n, 3) directions from (n, 3) points to the nearest box.

    inf where none is met; 0 for a point inside one. Both in the world frame.
    """
    nearest = np.full(len(directions), np.inf)
    for box in boxes:
        nearest = np.minimum(nearest, _distances(box, origins, directions))
    return nearest


def _distances(box: OrientedBox, origins: Floats, directions: Floats) -> Floats:
    """Return (n,) distances to one box: the rays' common part of its three slabs."""
    pose, half = box.world_from_box, 0.5 * np.asarray(box.size_m)
    # A row vector times the rotation is the inverse rotation of the vector.
    start = (origins - pose.translation) @ pose.rotation
    along = directions @ pose.rotation
    along = np.where(np.abs(along) < _LEVEL, _LEVEL, along)
    first, second = (-half - start) / along, (half - start) / along
    enter = np.minimum(first, second).max(axis=-1)
    leave = np.maximum(first, second).min(axis=-1)
    met: Bools = (enter <= leave) & (leave >= 0.0)
    return np.where(met, np.maximum(enter, 0.0), np.inf)
