"""Scenery: rooms and grounds with furniture, written by scripts, seeded.

A world names one: `Scenery=(Name=laboratory,Seed=1)`; its file keeps starts, sky, landmarks and
whatever the scenery dresses. `things` has the tools, `furniture` and `outdoors` the objects that
worlds share, `places` the worlds. A new scenery is a function and a line of `SCENERIES`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from catoptra_server.world.scenery.places import (
    furnish_arena,
    furnish_laboratory,
    furnish_offices,
    furnish_warehouse,
    furnish_yard,
)
from catoptra_server.world.scenery.things import Scenery
from catoptra_server.world.world_description import Item, RectangleLight

SCENERIES: dict[str, Callable[[Scenery], None]] = {
    "laboratory": furnish_laboratory,
    "offices": furnish_offices,
    "rescue": furnish_arena,
    "warehouse": furnish_warehouse,
    "yard": furnish_yard,
}


def add_scenery(
    name: str, seed: int, items: Iterable[Item]
) -> tuple[tuple[Item, ...], tuple[RectangleLight, ...]]:
    """Items and lamps of a scenery around, or in place of, the items of a world's file."""
    scenery = Scenery(items, seed)
    SCENERIES[name](scenery)
    return tuple(scenery.items), tuple(scenery.lamps)
