"""Triangles of a whole static world, the input of both renderers.

A triangle soup in the world frame: each triangle has one normal, one material and three texture
coordinates. Colours belong to materials; a mesh file with vertex colours has one material for each
distinct face colour.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import SourceLocation
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.memory_budget import BYTES_PER_TRIANGLE, MemoryBudget
from catoptra_server.scene import primitives
from catoptra_server.scene.landmark_shapes import items_from_landmark
from catoptra_server.scene.mesh_files import load_mesh_file
from catoptra_server.scene.primitives import Patch
from catoptra_server.scene.texture_files import Texture, load_texture
from catoptra_server.scene.world_description import (
    Box,
    Cylinder,
    Item,
    Material,
    MeshFile,
    Primitive,
    Rectangle,
    Rgb,
    Ring,
    SphereBand,
    World,
)


@dataclass(frozen=True, slots=True, eq=False)
class SceneMesh:
    """Triangles of a world."""

    corners: Floats
    """(n, 3, 3) metres, world frame."""
    normals: Floats
    """(n, 3) unit, from the winding; 0 for a triangle without area."""
    uv: Floats
    """(n, 3, 2) texture coordinates."""
    albedo: Floats
    """(n, 3) linear."""
    unlit: npt.NDArray[np.bool_]
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

    def __len__(self) -> int:
        """Number of triangles."""
        return len(self.corners)


@dataclass(frozen=True, slots=True, eq=False)
class _MeshPart:
    """Patch of one appearance, before concatenation."""

    item: int
    """Index of the item."""
    patch: Patch
    albedo: Rgb | Floats
    unlit: bool
    texture: Texture | None


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
    loader = _ItemLoader(world.name, memory or MemoryBudget())
    parts = [part for index, item in enumerate(items) for part in loader.load_parts(index, item)]
    return _concatenate_parts(parts, items)


def _concatenate_parts(parts: list[_MeshPart], items: tuple[Item, ...]) -> SceneMesh:
    counts = [len(part.patch.corners) for part in parts]
    textures: list[Texture] = []
    indices: list[int] = []
    for part in parts:
        # By identity, not by content: each file is loaded once.
        found = [i for i, texture in enumerate(textures) if texture is part.texture]
        if part.texture is not None and not found:
            textures.append(part.texture)
            found = [len(textures) - 1]
        indices.append(found[0] if found else -1)
    # An empty world is valid: concatenation needs at least one array of the right shape.
    empty = Patch(np.zeros((0, 3, 3)), np.zeros((0, 3, 2)))
    whole = primitives.concatenate([empty, *(part.patch for part in parts)])
    edges = whole.corners[:, 1:] - whole.corners[:, :1]
    cross = np.cross(edges[:, 0], edges[:, 1])
    # The winding alone gives the normal: vertex normals of files are ignored, facets are flat.
    length = np.linalg.norm(cross, axis=-1, keepdims=True)
    albedos = [np.broadcast_to(p.albedo, (n, 3)) for p, n in zip(parts, counts, strict=True)]
    mesh = SceneMesh(
        corners=whole.corners,
        normals=cross / np.where(length > 0.0, length, 1.0),
        uv=whole.uv,
        albedo=np.concatenate([np.zeros((0, 3)), *albedos]),
        unlit=np.repeat(np.array([part.unlit for part in parts], dtype=bool), counts),
        texture_index=np.repeat(np.array(indices, dtype=np.int32), counts),
        textures=tuple(textures),
        item_index=np.repeat(np.array([part.item for part in parts], dtype=np.int32), counts),
        item_names=tuple(item.name for item in items),
        casts_shadows=np.repeat(
            np.array([items[part.item].casts_shadows for part in parts], dtype=bool), counts
        ),
    )
    for array in (mesh.corners, mesh.normals, mesh.uv, mesh.albedo, mesh.unlit):
        array.setflags(write=False)
    return mesh


class _ItemLoader:
    """Loader of the items of one scene, within one memory budget."""

    def __init__(self, world_name: str, memory: MemoryBudget) -> None:
        self._where = SourceLocation(world_name)
        self._memory = memory
        self._textures: dict[Path, Texture] = {}

    def load_parts(self, index: int, item: Item) -> Iterator[_MeshPart]:
        """Yield the parts of an item, each of one appearance."""
        if isinstance(item.shape, MeshFile):
            yield from self._load_mesh_file(index, item, item.shape)
            return
        assert item.material is not None, "only mesh files bring materials of their own"
        num_triangles = primitives.max_triangles(item.shape)
        self._memory.reserve(
            BYTES_PER_TRIANGLE * num_triangles,
            where=self._where,
            key=item.name,
            value=f"{num_triangles} triangles",
            remedy="fewer items, Sectors or Rings",
        )
        patch = _transform_to_world(_build_shape(item.shape), item)
        texture = self._load_texture(item.material)
        yield _MeshPart(index, patch, item.material.albedo, item.material.unlit, texture)

    def _load_mesh_file(self, index: int, item: Item, shape: MeshFile) -> Iterator[_MeshPart]:
        for mesh in load_mesh_file(shape, self._memory):
            patch = _transform_to_world(mesh.patch, item)
            material = item.material
            if material is None:
                yield _MeshPart(index, patch, mesh.albedo, False, mesh.texture)
            else:
                texture = self._load_texture(material)
                yield _MeshPart(index, patch, material.albedo, material.unlit, texture)

    def _load_texture(self, material: Material) -> Texture | None:
        """Texture of a material, loaded once for all items that have it."""
        if material.texture is None:
            return None
        path = material.texture.resolve()
        if path not in self._textures:
            self._textures[path] = load_texture(path, self._memory)
        return self._textures[path]


def _build_shape(shape: Primitive) -> Patch:
    match shape:
        case Box():
            return primitives.box(shape)
        case Cylinder():
            return primitives.cylinder(shape)
        case Rectangle():
            return primitives.rectangle(shape)
        case Ring():
            return primitives.ring(shape)
        case SphereBand():
            return primitives.sphere_band(shape)


def _transform_to_world(patch: Patch, item: Item) -> Patch:
    return Patch(item.world_from_item.transform_points(patch.corners), patch.uv)
