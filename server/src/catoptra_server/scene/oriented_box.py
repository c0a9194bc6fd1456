"""Boxes that stand anywhere, and where rays meet them: what robots are to each other's sensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.transforms import Pose

# Stands for a direction's component of 0: its slab is then crossed at +-1e200 times a length,
# behind every distance and still finite.
_MIN_DIRECTION_COMPONENT = 1e-200


class OrientedBox(NamedTuple):
    """A box of full edge lengths `size_m` (length, width, height), centred on its pose."""

    world_from_box: Pose
    size_m: tuple[float, float, float]


def box_distances(boxes: Sequence[OrientedBox], origins: Floats, directions: Floats) -> Floats:
    """Return (n,) metres along unit (n, 3) directions from (n, 3) points to the nearest box.

    inf where none is met; 0 for a point inside one. Both in the world frame.
    """
    if not boxes:
        return np.full(len(directions), np.inf)
    rotations = np.stack([box.world_from_box.rotation for box in boxes])
    centres = np.stack([box.world_from_box.translation for box in boxes])
    half = 0.5 * np.array([box.size_m for box in boxes]).T[..., None]
    # (3, k, n), components first, all boxes at once: 0.2 ms for 400 rays and 7 boxes, box by box
    # 0.5 ms; measured in tests/measurements/sensor_times.py.
    start = (
        _components_in_boxes(rotations, origins)
        - np.einsum("ki,kij->jk", centres, rotations)[..., None]
    )
    along = _components_in_boxes(rotations, directions)
    return _nearest_slab_hit(
        start,
        np.where(np.abs(along) < _MIN_DIRECTION_COMPONENT, _MIN_DIRECTION_COMPONENT, along),
        half,
    )


def closest_box_hits(
    boxes: Sequence[OrientedBox], origins: Floats, directions: Floats
) -> tuple[Floats, Floats]:
    """Return `box_distances`, and the (n, 3) unit normals of what is met; 0 where nothing is.

    From inside a box the normal faces the ray. Box by box: it is rarely asked for.
    """
    nearest, normals = np.full(len(directions), np.inf), np.zeros(directions.shape)
    for box in boxes:
        distances = box_distances([box], origins, directions)
        is_nearer = distances < nearest
        nearest = np.where(is_nearer, distances, nearest)
        normals[is_nearer] = _box_normals(box, origins, directions)[is_nearer]
    return nearest, normals


def _box_normals(box: OrientedBox, origins: Floats, directions: Floats) -> Floats:
    """Return (n, 3) normals of the faces by which rays that meet a box enter it."""
    rotation = box.world_from_box.rotation
    start = (origins - box.world_from_box.translation) @ rotation
    along = directions @ rotation
    along = np.where(np.abs(along) < _MIN_DIRECTION_COMPONENT, _MIN_DIRECTION_COMPONENT, along)
    enter = (-np.copysign(0.5 * np.array(box.size_m), along) - start) / along
    face = enter.argmax(axis=1)
    rows = np.arange(len(directions))
    normals: Floats = -np.sign(along[rows, face])[:, None] * rotation.T[face]
    return np.where(enter[rows, face, None] > 0.0, normals, -directions)


def _components_in_boxes(rotations: Floats, vectors: Floats) -> Floats:
    """Return (3, k, n) components of (n, 3) vectors along the axes of k boxes."""
    count = len(rotations)
    columns = rotations.transpose(1, 2, 0).reshape(3, 3 * count)
    return np.ascontiguousarray((vectors @ columns).T).reshape(3, count, -1)


def _nearest_slab_hit(start: Floats, along: Floats, half: Floats) -> Floats:
    """Return (n,) distances to the nearest of k boxes: the common part of three slabs."""
    first, second = (-half - start) / along, (half - start) / along
    enter = np.minimum(first, second).max(axis=0)
    leave = np.maximum(first, second).min(axis=0)
    met: Bools = (enter <= leave) & (leave >= 0.0)
    nearest: Floats = np.where(met, np.maximum(enter, 0.0), np.inf).min(axis=0)
    return nearest
