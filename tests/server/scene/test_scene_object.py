"""Names and classes of the parts of items."""

from __future__ import annotations

import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.world.world_description import Box, Item, SceneObject, object_of_part

ITEM = Item("office", Box((1.0, 1.0, 1.0)), Pose.identity(), None)


@pytest.mark.parametrize(
    ("node", "expected"),
    [
        ("", SceneObject("office", "object")),
        ("chair", SceneObject("office/chair", "chair")),
        ("chair.001", SceneObject("office/chair.001", "chair")),
        ("Desk_12", SceneObject("office/Desk_12", "Desk")),
        ("007", SceneObject("office/007", "object")),
    ],
)
def test_node_names_object_and_class(node: str, expected: SceneObject) -> None:
    assert object_of_part(ITEM, node) == expected


def test_class_of_the_world_file_overrides_the_node() -> None:
    item = Item("office", ITEM.shape, ITEM.world_from_item, None, class_name="furniture")
    assert object_of_part(item, "chair") == SceneObject("office/chair", "furniture")
