"""Triangles of a world's items: shapes built, mesh files and textures loaded, within one budget."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.memory_budget import BYTES_PER_TRIANGLE, MemoryBudget
from catoptra_server.scene import primitives
from catoptra_server.scene.facets import facet_normals
from catoptra_server.scene.mesh_appearance import MeshAppearance, no_texture_coordinates
from catoptra_server.scene.mesh_files import load_mesh_file
from catoptra_server.scene.primitives import Patch
from catoptra_server.scene.row_blocks import row_blocks
from catoptra_server.scene.texture_files import Texture, load_texture
from catoptra_server.scene.world_description import (
    Box,
    Cylinder,
    Item,
    Material,
    MeshFile,
    Primitive,
    Rectangle,
    Ring,
    SphereBand,
)


@dataclass(frozen=True, slots=True, eq=False)
class ItemPart:
    """Triangles of an item that share an appearance."""

    item: int
    """Index of the item."""
    corners: Floats
    """(n, 3, 3) metres, world frame."""
    normals: Floats
    """(n, 3) unit, world frame, from the winding; 0 for a triangle without area."""
    appearance: MeshAppearance
    node: str = ""
    """Node of the item's mesh file; empty for one that has no nodes."""


def empty_part() -> ItemPart:
    """Part without a triangle."""
    no_vectors = np.zeros((0, 3))
    appearance = MeshAppearance(no_texture_coordinates(0), no_vectors, None, None, unlit=False)
    return ItemPart(-1, np.zeros((0, 3, 3)), no_vectors, appearance)


class ItemLoader:
    """Loader of the items of one scene."""

    def __init__(self, world_name: str, memory: MemoryBudget) -> None:
        """Load nothing yet.

        Args:
            world_name: named in errors.
            memory: budget of all triangles and textures.
        """
        self._where = SourceLocation(world_name)
        self._memory = memory
        self._textures: dict[Path, Texture] = {}

    def load_parts(self, index: int, item: Item) -> Iterator[ItemPart]:
        """Yield the parts of an item.

        Raises:
            ConfigError: A mesh or texture file is missing or unusable, or the budget is exceeded.
        """
        try:
            yield from self._load_parts(index, item)
        except ConfigError as error:
            if item.where is None:
                raise
            # The line that names the file: a mesh may be one of fifty, and refer to others.
            source = str(error.location)
            expected = error.expected if source == error.value else f"{error.expected}; {source}"
            key = f"{item.name}.{error.key}"
            raise ConfigError(item.where, key=key, value=error.value, expected=expected) from error

    def _load_parts(self, index: int, item: Item) -> Iterator[ItemPart]:
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
        patch = _build_shape(item.shape)
        corners = item.world_from_item.transform_points(patch.corners)
        # The winding alone gives the normal: vertex normals of files are ignored, facets are flat.
        normals, _ = facet_normals(corners)
        yield ItemPart(index, corners, normals, self._apply_material(patch.uv, item.material))

    def _load_mesh_file(self, index: int, item: Item, shape: MeshFile) -> Iterator[ItemPart]:
        for mesh in load_mesh_file(shape, self._memory):
            appearance = mesh.appearance
            if item.material is not None:
                appearance = self._apply_material(appearance.uv, item.material)
            if item.unlit is not None:
                appearance = replace(appearance, unlit=item.unlit)
            _transform_to_world(mesh.corners, mesh.normals, item.world_from_item)
            yield ItemPart(index, mesh.corners, mesh.normals, appearance, mesh.node)

    def _apply_material(self, uv: Floats, material: Material) -> MeshAppearance:
        """Appearance of n triangles of a material, with (n, 3, 2) texture coordinates."""
        albedo = np.broadcast_to(np.array(material.albedo), (len(uv), 3))
        texture = self._load_texture(material)
        return MeshAppearance(uv, albedo, None, texture, unlit=material.unlit)

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


def _transform_to_world(corners: Floats, normals: Floats, world_from_item: Pose) -> None:
    """Move (n, 3, 3) corners and (n, 3) normals into the world.

    In place: new arrays of a million triangles are 96 MB, which a process gets page by page in up
    to 0.2 s.
    """
    rotation, translation = world_from_item.rotation, world_from_item.translation
    if np.array_equal(rotation, np.eye(3)):
        if translation.any():
            corners += translation
        return
    for block in row_blocks(len(corners)):
        # Rows of points: a product of n small matrices takes five times as long.
        moved = world_from_item.transform_points(corners[block].reshape(-1, 3))
        corners[block] = moved.reshape(-1, 3, 3)
        normals[block] = world_from_item.rotate_directions(normals[block])
