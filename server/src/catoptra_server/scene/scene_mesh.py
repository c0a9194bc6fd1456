"""Triangles of a whole static world, the input of both renderers.

A triangle soup in the world frame: each triangle has one normal, one material and three texture
coordinates. Colours belong to materials; only a mesh file with colours at its vertices has colours
that vary over a triangle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.memory_budget import MemoryBudget
from catoptra_server.scene.facets import bounding_box
from catoptra_server.scene.item_loader import ItemLoader, ItemPart, empty_part
from catoptra_server.scene.landmark_shapes import items_from_landmark
from catoptra_server.scene.mesh_appearance import MeshAppearance, no_texture_coordinates
from catoptra_server.scene.occlusion_map import OcclusionMap
from catoptra_server.scene.scene_object import SceneObject, object_of_part
from catoptra_server.scene.texture_files import Texture
from catoptra_server.scene.world_description import Item, World


@dataclass(frozen=True, slots=True, eq=False)
class SceneMesh:
    """Triangles of a world."""

    corners: Floats
    """(n, 3, 3) metres, world frame."""
    normals: Floats
    """(n, 3) unit, from the winding; 0 for a triangle without area."""
    uv: Floats
    """(n, 3, 2) texture coordinates; zeros that take no memory in a scene without textures."""
    albedo: Floats
    """(n, 3) linear; the mean of the corners where these differ."""
    unlit: Bools
    """(n,) whether the triangle is shown at its albedo, whatever the lights."""
    texture_index: npt.NDArray[np.int32]
    """(n,) index into `textures`; -1 for none."""
    textures: tuple[Texture, ...]
    """(h, w, 3) uint8 sRGB each."""
    item_index: npt.NDArray[np.int32]
    """(n,) index into `item_names`."""
    item_names: tuple[str, ...]
    """Names of the world's items, landmarks' last."""
    casts_shadows: Bools
    """(n,) whether the triangle occludes lights."""
    object_index: npt.NDArray[np.int32]
    """(n,) index into `objects`."""
    objects: tuple[SceneObject, ...]
    """Objects in the order of their first items, landmarks last."""
    corner_albedo: Floats | None = None
    """(n, 3, 3) linear albedos at the corners, interpolated linearly over each triangle; None in a
    scene whose triangles have one albedo each."""
    occlusion: OcclusionMap | None = None
    """How much of the sky's light reaches each point; None: all of it, everywhere."""
    box_min: Floats = field(init=False)
    """(3,) smallest coordinates; inf in a scene without triangles."""
    box_max: Floats = field(init=False)
    """(3,) largest coordinates; -inf in a scene without triangles."""

    def __post_init__(self) -> None:
        """Find the box around all triangles, which renderers and bounds need in several places."""
        low, high = bounding_box(self.corners)
        object.__setattr__(self, "box_min", low)
        object.__setattr__(self, "box_max", high)
        for array in (self.corners, self.normals, self.uv, self.albedo, self.unlit, low, high):
            array.setflags(write=False)

    def __len__(self) -> int:
        """Number of triangles."""
        return len(self.corners)

    def max_albedo(self, triangles: slice | npt.NDArray[np.intp]) -> Floats:
        """(m, 3) largest albedo of each of some triangles, in each colour channel."""
        if self.corner_albedo is None:
            return self.albedo[triangles]
        first, second, third = np.moveaxis(self.corner_albedo[triangles], 1, 0)
        largest: Floats = np.maximum(np.maximum(first, second), third)
        return largest

    def smallest_sky_factors(self, triangles: slice) -> Floats:
        """(m,) smallest factor of hemisphere light on each of some triangles."""
        if self.occlusion is None:
            return np.ones(len(self.corners[triangles]))
        return self.occlusion.smallest_factors(triangles)

    def has_varying_albedo(self, triangles: slice) -> Bools:
        """(m,) triangles of which some points may be darker than `max_albedo`, by any factor."""
        index = self.texture_index[triangles]
        return index >= 0 if self.corner_albedo is None else np.ones(len(index), dtype=bool)


def build_scene(world: World, memory: MemoryBudget | None = None) -> SceneMesh:
    """Build the triangles of a world, landmarks included.

    Args:
        world: the description.
        memory: budget of all triangles and textures; None for the default.

    Raises:
        ConfigError: A mesh or texture file is missing or unusable, or the budget is exceeded.
    """
    landmark_items = [
        item
        for landmark in world.landmarks
        for item in items_from_landmark(landmark, world.landmark_albedos)
    ]
    items = (*world.items, *landmark_items)
    loader = ItemLoader(world.name, memory or MemoryBudget())
    parts = [part for index, item in enumerate(items) for part in loader.load_parts(index, item)]
    return _concatenate_parts(parts, items)


def _concatenate_parts(parts: list[ItemPart], items: tuple[Item, ...]) -> SceneMesh:
    # An empty world is valid: concatenation needs at least one array of the right shape.
    parts = parts or [empty_part()]
    looks = [part.appearance for part in parts]
    counts = [len(part.corners) for part in parts]
    owners = [object_of_part(items[part.item], part.node) for part in parts if part.item >= 0]
    objects = tuple(dict.fromkeys(owners))
    numbers = {one: index for index, one in enumerate(objects)}
    textures = _distinct_textures(looks)
    casts_shadows = [part.item >= 0 and items[part.item].casts_shadows for part in parts]
    return SceneMesh(
        corners=_concatenate([part.corners for part in parts]),
        normals=_concatenate([part.normals for part in parts]),
        uv=_concatenate([look.uv for look in looks])
        if textures
        else no_texture_coordinates(sum(counts)),
        albedo=_concatenate([look.albedo for look in looks]),
        corner_albedo=_concatenate_corner_albedos(looks),
        unlit=np.repeat(np.array([look.unlit for look in looks]), counts),
        texture_index=_repeat([_find_texture(textures, look.texture) for look in looks], counts),
        textures=tuple(textures),
        item_index=_repeat([part.item for part in parts], counts),
        item_names=tuple(item.name for item in items),
        casts_shadows=np.repeat(np.array(casts_shadows), counts),
        object_index=_repeat([numbers[owner] for owner in owners] or [-1], counts),
        objects=objects,
    )


def _distinct_textures(looks: list[MeshAppearance]) -> list[Texture]:
    """Textures of all parts, by identity, not by content: each file is loaded once."""
    by_identity = {id(look.texture): look.texture for look in looks}
    return [texture for texture in by_identity.values() if texture is not None]


def _find_texture(textures: list[Texture], texture: Texture | None) -> int:
    """Index of a texture; -1 for none."""
    return next((index for index, other in enumerate(textures) if other is texture), -1)


def _repeat(values: list[int], counts: Sequence[int]) -> npt.NDArray[np.int32]:
    return np.repeat(np.array(values, dtype=np.int32), counts)


def _concatenate(arrays: list[Floats]) -> Floats:
    """All rows; the array itself where there is one, so that a large mesh is not copied."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays)


def _concatenate_corner_albedos(looks: list[MeshAppearance]) -> Floats | None:
    """(n, 3, 3) albedos at the corners; None where all triangles have one albedo each."""
    if all(look.corner_albedo is None for look in looks):
        return None
    return _concatenate([_albedos_at_corners(look) for look in looks])


def _albedos_at_corners(look: MeshAppearance) -> Floats:
    if look.corner_albedo is not None:
        return look.corner_albedo
    return np.broadcast_to(look.albedo[:, None], (len(look.albedo), 3, 3))
