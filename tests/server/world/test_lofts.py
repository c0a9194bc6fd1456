"""Lofts: closed, outward, of the volume of the solid."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world import lofts
from catoptra_server.world.shapes import Patch

SQUARE = lofts.octagon(0.5, 0.25, 0.0625, 0.0625)
# Between the tangents of both circles: a trapezium, and a sector of each.
TURN = math.acos((0.2 - 0.1) / 0.5)
BELT = (0.3 * 0.5 * math.sin(TURN)) + (math.pi - TURN) * 0.2**2 + TURN * 0.1**2
SOLIDS = {
    "cone": (lofts.revolve([(0.5, 0.0), (0.0, 1.5)], 400), math.pi * 0.25 * 1.5 / 3, 1e-3),
    "upside down": (lofts.revolve([(0.0, 1.5), (0.5, 0.0)], 400), math.pi * 0.25 * 0.5, 1e-3),
    "prism": (lofts.prism(SQUARE, [(0.0, 0.0), (2.0, 0.0)]), 2.0 * (0.5 - 0.0625**2 * 2), 1e-12),
    "inset": (lofts.prism(SQUARE, [(0.0, 0.1), (2.0, 0.1)])
              , 2.0 * (0.24 - 2 * (0.0625 - 0.1 * (2 - math.sqrt(2)))**2), 1e-12),
    "block": (lofts.block((1.0, 0.5, 0.2), 1e-6), 0.1, 1e-4),
    "tube": (lofts.tube((1.0, 2.0, 3.0), (0.0, 2.5, 2.0), 0.1, 400), math.pi * 0.01 * 1.5, 1e-3),
    "belt": (lofts.belt(0.5, (0.2, 0.1), 0.3, 0.0, 0.01), 0.3 * BELT, 1e-2),
}  # fmt: skip


@pytest.mark.parametrize("name", SOLIDS)
def test_solid_is_closed_and_faces_outwards(name: str) -> None:
    patch, volume, tolerance = SOLIDS[name]
    moved = lofts.transform(patch, Pose.from_rpy((3.0, -1.0, 2.0), (0.3, 0.2, 0.1)))
    for solid in (patch, moved):
        a, b, c = np.moveaxis(solid.corners, 1, 0)
        assert np.abs(np.cross(b - a, c - a).sum(axis=0)).max() < 1e-12
        assert (a * np.cross(b, c)).sum() / 6.0 == pytest.approx(volume, rel=tolerance)
    assert isinstance(moved, Patch)


def test_tube_reaches_from_point_to_point() -> None:
    corners = lofts.tube((1.0, 2.0, 3.0), (1.0, 2.0, 2.5), 0.1).corners
    np.testing.assert_allclose(corners.min((0, 1)), (0.9, 1.9, 2.5), atol=1e-12)
    np.testing.assert_allclose(corners.max((0, 1)), (1.1, 2.1, 3.0), atol=1e-12)


def test_belt_has_lugs_of_their_height_and_pitch() -> None:
    points = lofts.belt(0.5, (0.1, 0.1), 0.3, 0.02, 0.05).corners.reshape(-1, 3)
    straight = points[(points[:, 0] > 0.0) & (points[:, 0] < 0.5) & (points[:, 1] > 0.05)]
    heights = np.unique(straight[:, 1].round(9))
    np.testing.assert_allclose(heights, (0.08, 0.1))
    tops = np.unique(straight[straight[:, 1] > 0.09, 0].round(6))
    assert np.diff(tops)[:2].sum() == pytest.approx(0.05, rel=0.05)
