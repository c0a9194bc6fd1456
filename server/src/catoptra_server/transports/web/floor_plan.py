"""Section of the world by a level plane, for the page's map."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.world.scene_mesh import SceneMesh

# Height of a robot's sensors: walls, furniture and landmarks are cut, floors and carpets are not.
HEIGHT_M = 0.3
MAX_SEGMENTS = 4000
# Triangles that are cut at once: 20 MB of temporary arrays.
_BLOCK = 65536
# A millimetre: shorter ones are invisible on any map.
_MIN_LENGTH_M = 1e-3


def floor_plan(scene: SceneMesh, height_m: float = HEIGHT_M) -> dict[str, object]:
    """Section as a JSON object: segments [x1, y1, x2, y2] and bounds, metres in the world frame.

    Args:
        scene: Triangles of the world.
        height_m: Height of the plane above the origin of the world.
    """
    segments = section_segments(scene.corners, -height_m)  # z points down
    points = segments.reshape(-1, 2)
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else _scene_bounds(scene)
    return {
        "segments": np.round(segments, 4).tolist(),
        "bounds": [*map(float, low), *map(float, high)],
        "height_m": height_m,
    }


def section_segments(corners: Floats, z_m: float, *, max_segments: int = MAX_SEGMENTS) -> Floats:
    """Segments (m, 4) in which a level plane cuts triangles, the longest ones, sorted by length.

    Args:
        corners: (n, 3, 3) triangles.
        z_m: Plane.
        max_segments: Largest number of segments.
    """
    longest = np.zeros((0, 4))
    for first in range(0, len(corners), _BLOCK):
        cut = _cut_triangles(corners[first : first + _BLOCK], z_m)
        # Both sides of a thin wall, and each shared edge, are one line on a map.
        longest = _longest(np.concatenate((longest, cut)), max_segments)
    return longest


def _cut_triangles(corners: Floats, z_m: float) -> Floats:
    """Segments (m, 4) of triangles (n, 3, 3); those that lie in the plane have none."""
    # A corner in the plane counts as above: each triangle then has 0 or 2 crossed edges.
    is_above = corners[..., 2] <= z_m
    num_above = is_above.sum(axis=1)
    corners, is_above = corners[crossed := (num_above % 3 != 0)], is_above[crossed]
    if not len(corners):
        return np.zeros((0, 4))
    # The corner that is alone on its side comes first: the edges to both others are crossed.
    is_alone = is_above == (is_above.sum(axis=1) == 1)[:, None]
    order = (np.argmax(is_alone, axis=1)[:, None] + np.arange(3)) % 3
    apex, *others = np.moveaxis(np.take_along_axis(corners, order[..., None], axis=1), 1, 0)
    ends = []
    for other in others:
        part = (z_m - apex[:, 2]) / (other[:, 2] - apex[:, 2])
        ends.append(apex[:, :2] + part[:, None] * (other[:, :2] - apex[:, :2]))
    return np.concatenate(ends, axis=1)


def _longest(segments: Floats, max_segments: int) -> Floats:
    """Longest segments, longest first, each once."""
    length_m = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    segments, length_m = segments[visible := length_m >= _MIN_LENGTH_M], length_m[visible]
    order = np.argsort(-length_m, kind="stable")
    segments = segments[order]
    # To a tenth of a millimetre, and in either direction, a segment is drawn once.
    keys = np.round(segments * 1e4)
    is_reversed = (keys[:, 0] > keys[:, 2]) | (
        (keys[:, 0] == keys[:, 2]) & (keys[:, 1] > keys[:, 3])
    )
    keys[is_reversed] = keys[is_reversed][:, [2, 3, 0, 1]]
    _, first = np.unique(keys, axis=0, return_index=True)
    return segments[np.sort(first)[:max_segments]]


def _scene_bounds(scene: SceneMesh) -> tuple[Floats, Floats]:
    """Bounds of a world without walls; a square of one metre without any triangle."""
    if not len(scene):
        return np.array([-0.5, -0.5]), np.array([0.5, 0.5])
    return scene.box_min[:2], scene.box_max[:2]
