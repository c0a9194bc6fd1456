"""Landmark shapes: positions and colours as the landmark file documents."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.world.scene_mesh import WHITE, SceneMesh, build_scene, items_from_landmark
from catoptra_server.world.world_description import Cylinder, World

ALBEDOS = {"cyan": (0.0, 0.4, 0.7), "magenta": (0.8, 0.0, 0.3), "yellow": (0.9, 0.7, 0.0)}
BEACON = Landmark("b", "beacon", 1.35, -1.9, 0.1, 0.1, 0.2, 0.4, "yellow", "magenta")
GOAL = Landmark("g", "goal", 2.7, 0.1, 0.8, 0.3, 0.0, 0.3, "cyan", "cyan")
OTHER_GOAL = Landmark("g", "goal", -2.7, 0.1, 0.8, 0.3, 0.0, 0.3, "cyan", "cyan")


def build_landmark(landmark: Landmark) -> SceneMesh:
    return build_scene(World("w", (), landmarks=(landmark,), landmark_albedos=ALBEDOS))


def bounds(scene: SceneMesh, part: str) -> tuple[Floats, Floats]:
    """Lower and upper (x, y, height) of an item."""
    index = scene.item_names.index(part)
    corners = scene.corners[scene.item_index == index] * (1.0, 1.0, -1.0)
    return corners.min(axis=(0, 1)), corners.max(axis=(0, 1))


@pytest.mark.parametrize(
    ("part", "bottom", "top", "albedo"),
    [
        ("b.post", 0.0, 0.2, WHITE),
        ("b.lower", 0.2, 0.3, ALBEDOS["yellow"]),
        ("b.upper", 0.3, 0.4, ALBEDOS["magenta"]),
    ],
)
def test_beacon_has_its_bands_at_the_documented_heights(
    part: str, bottom: float, top: float, albedo: tuple[float, float, float]
) -> None:
    scene = build_landmark(BEACON)
    lower, upper = bounds(scene, part)
    np.testing.assert_allclose(lower, (1.3, -1.95, bottom), atol=1e-9)
    np.testing.assert_allclose(upper, (1.4, -1.85, top), atol=1e-9)
    item = items_from_landmark(BEACON, ALBEDOS)[scene.item_names.index(part)]
    assert isinstance(item.shape, Cylinder)
    assert item.material is not None
    assert item.material.albedo == albedo


def test_beacon_with_a_band_at_the_floor_has_no_post() -> None:
    low = Landmark("b", "beacon", 0, 0, 0.1, 0.1, 0.0, 0.4, "cyan", "cyan")
    assert [item.name for item in items_from_landmark(low, ALBEDOS)] == ["b.lower", "b.upper"]


@pytest.mark.parametrize(("goal", "outward"), [(GOAL, 1.0), (OTHER_GOAL, -1.0)])
def test_goal_is_open_towards_the_origin(goal: Landmark, outward: float) -> None:
    scene = build_landmark(goal)
    xs = outward * scene.corners[..., 0]
    # From the mouth on the goal line to the back board, 0.3 m behind and 0.02 m thick.
    assert (xs.min(), xs.max()) == pytest.approx((2.7, 3.02))
    lower, upper = bounds(scene, "g.back")
    assert min(abs(lower[0]), abs(upper[0])) == pytest.approx(3.0)


def test_goal_has_its_mouth_between_the_side_boards() -> None:
    scene = build_landmark(GOAL)
    _, left = bounds(scene, "g.left")
    right, _ = bounds(scene, "g.right")
    assert (left[1], right[1]) == pytest.approx((0.1 - 0.4, 0.1 + 0.4))
    assert (scene.corners[..., 2].min(), scene.corners[..., 2].max()) == pytest.approx((-0.3, 0.0))


def test_goal_has_its_colour() -> None:
    np.testing.assert_array_equal(np.unique(build_landmark(GOAL).albedo, axis=0), [ALBEDOS["cyan"]])
