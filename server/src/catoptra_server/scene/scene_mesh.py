"""From a world's description to triangles that both renderers draw; the one door to trimesh.

The result is a triangle soup in the world frame: one normal, one material, three texture
coordinates a triangle. Colours are per material; meshes with vertex colours get one material per
distinct face colour.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.scene import primitives
from catoptra_server.scene.landmark_shapes import items_from_landmark
from catoptra_server.scene.mesh_files import load_mesh_file
from catoptra_server.scene.primitives import Patch
from catoptra_server.scene.world_description import (
    Box,
    Cylinder,
    Item,
    MeshFile,
    Rectangle,
    Rgb,
    Ring,
    SphereBand,
    World,
)

Texture = npt.NDArray[np.uint8]  # (h, w, 3) sRGB, row 0 at the top


@dataclass(frozen=True, slots=True, eq=False)
class SceneMesh:
    """Triangles of a whole world.

    corners: (n, 3, 3) float64 metres, world frame. normals: (n, 3) unit, from the winding.
    uv: (n, 3, 2). albedo: (n, 3) linear. unlit: (n,) bool. texture_index: (n,), -1 = none.
    textures: (h, w, 3) uint8 sRGB each. item_index: (n,), which item of `item_names` it belongs to.
    casts_shadows: (n,) whether it hides lights.
    """

    corners: Floats
    normals: Floats
    uv: Floats
    albedo: Floats
    unlit: npt.NDArray[np.bool_]
    texture_index: npt.NDArray[np.int32]
    textures: tuple[Texture, ...]
    item_index: npt.NDArray[np.int32]
    item_names: tuple[str, ...]
    casts_shadows: Bools

    def __len__(self) -> int:
        """Return the number of triangles."""
        return len(self.corners)


@dataclass(frozen=True, slots=True, eq=False)
class _MeshPart:
    """A patch of one look, before all are joined."""

    item: int
    patch: Patch
    albedo: Rgb | Floats
    unlit: bool
    texture: Texture | None


def build_scene(world: World) -> SceneMesh:
    """Return the triangles of a world. Raises ConfigError for an unusable mesh or texture."""
    drawn = [
        item
        for landmark in world.landmarks
        for item in items_from_landmark(landmark, world.landmark_albedos)
    ]
    items = (*world.items, *drawn)
    parts = [part for index, item in enumerate(items) for part in _item_parts(index, item)]
    return _concatenate_parts(parts, items)


def _concatenate_parts(parts: list[_MeshPart], items: tuple[Item, ...]) -> SceneMesh:
    counts = [len(part.patch.corners) for part in parts]
    textures: list[Texture] = []
    indices: list[int] = []
    for part in parts:
        known = [i for i, texture in enumerate(textures) if texture is part.texture]
        if part.texture is not None and not known:
            textures.append(part.texture)
            known = [len(textures) - 1]
        indices.append(known[0] if known else -1)
    empty = Patch(np.zeros((0, 3, 3)), np.zeros((0, 3, 2)))
    whole = primitives.concatenate([empty, *(part.patch for part in parts)])
    edges = whole.corners[:, 1:] - whole.corners[:, :1]
    cross = np.cross(edges[:, 0], edges[:, 1])
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


def _item_parts(index: int, item: Item) -> Iterator[_MeshPart]:
    if isinstance(item.shape, MeshFile):
        yield from _mesh_file_parts(index, item, item.shape)
        return
    assert item.material is not None, "only mesh files bring materials of their own"
    texture = load_texture(item.material.texture) if item.material.texture else None
    patch = _transform_to_world(_build_shape(item.shape), item)
    yield _MeshPart(index, patch, item.material.albedo, item.material.unlit, texture)


def _build_shape(shape: Box | Cylinder | Rectangle | Ring | SphereBand) -> Patch:
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


def load_texture(path: Path) -> Texture:
    """Return an image file as (h, w, 3) uint8 sRGB. Raises ConfigError if it is none."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            texture = np.array(image.convert("RGB"))
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise ConfigError(
            SourceLocation(str(path)),
            key="Texture",
            value=str(path),
            expected=f"an image file ({error})",
        ) from error
    texture.setflags(write=False)
    return texture


def _mesh_file_parts(index: int, item: Item, shape: MeshFile) -> Iterator[_MeshPart]:
    for mesh in load_mesh_file(shape):
        patch = _transform_to_world(mesh.patch, item)
        if item.material is None:
            yield _MeshPart(index, patch, mesh.albedo, False, mesh.texture)
        else:
            own = load_texture(item.material.texture) if item.material.texture else None
            yield _MeshPart(index, patch, item.material.albedo, item.material.unlit, own)
