"""Objects of a world: what labels count as one thing, with a name and a class.

Items of one object name are one object. A glTF file has an object for each of its nodes, named
after both; its class is the node's name without a trailing number, as modelling programs count
copies (chair.001, chair_2).
"""

from __future__ import annotations

import re

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.scene.world_description import Item

DEFAULT_CLASS = "object"
"""Class of an item whose file names none."""
ROBOT_CLASS = "robot"

_COPY_NUMBER = re.compile(r"[ ._-]*\d+$")


@dataclass(frozen=True, slots=True)
class SceneObject:
    """One thing in the static scene."""

    name: str
    class_name: str


def object_of_part(item: Item, node: str = "") -> SceneObject:
    """Object that a part of an item belongs to.

    Args:
        item: The item.
        node: Node of the item's mesh file; empty for one that has no nodes.
    """
    name = item.object_name or item.name
    if not node:
        return SceneObject(name, item.class_name or DEFAULT_CLASS)
    class_name = item.class_name or _COPY_NUMBER.sub("", node) or DEFAULT_CLASS
    return SceneObject(f"{name}/{node}", class_name)
