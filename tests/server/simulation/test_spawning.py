"""Class, pose and name of INIT."""

from __future__ import annotations

import pytest

from catoptra_protocol.usarsim.commands import Init
from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_server.simulation.spawning import find_class, spawn_pose, unique_name
from helpers.robots import make_p2at, make_walled_world

CLASSES = (make_p2at(class_name="USARBot.P2AT"), make_p2at(class_name="USARBot.P2DX"))


@pytest.mark.parametrize(
    ("name", "index"), [("P2DX", 1), ("usarbot.p2at", 0), ("P2", None), ("", None)]
)
def test_class_when_named_is_found_in_any_case(name: str, index: int | None) -> None:
    assert find_class(CLASSES, name) is (None if index is None else CLASSES[index])


def test_pose_at_a_named_start_is_the_start_s() -> None:
    pose = spawn_pose(Init("X", start="aside"), make_walled_world().starts)
    assert pose == PlanarPose(1.0, -2.0, 1.5)
    assert spawn_pose(Init("X", start="nowhere"), make_walled_world().starts) is None


def test_name_in_use_gets_the_first_free_number() -> None:
    assert unique_name("R", {"R", "R2", "R4"}) == "R3"
    assert unique_name("R", set()) == "R"
