"""From a world's description to triangles that both renderers draw; the one door to trimesh.

The result is a triangle soup in the world frame: one normal, one material, three texture
coordinates a triangle. Colours are per material; meshes with vertex colours get one material per
distinct face colour.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import ConfigError, Where
from catoptra_protocol.optics.frames import rotation_from_rpy
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.scene import primitives
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.description import (
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
from catoptra_server.scene.landmark_shapes import items_from_landmark
from catoptra_server.scene.primitives import Patch

Texture = npt.NDArray[np.uint8]  # (h, w, 3) sRGB, row 0 at the top


@dataclass(frozen=True, slots=True, eq=False)
class SceneMesh:
    """Triangles of a whole world.

    corners: (n, 3, 3) float64 metres, world frame. normals: (n, 3) unit, from the winding.
    uv: (n, 3, 2). albedo: (n, 3) linear. unlit: (n,) bool. texture_index: (n,), -1 = none.
    textures: (h, w, 3) uint8 sRGB each. item_index: (n,), which item of `item_names` it belongs to.
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

    def __len__(self) -> int:
        """Return the number of triangles."""
        return len(self.corners)


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
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
    parts = [part for index, item in enumerate(items) for part in _parts(index, item)]
    return _joined(parts, tuple(item.name for item in items))


def _joined(parts: list[_Part], names: tuple[str, ...]) -> SceneMesh:
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
    whole = primitives.joined([empty, *(part.patch for part in parts)])
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
        item_names=names,
    )
    for array in (mesh.corners, mesh.normals, mesh.uv, mesh.albedo, mesh.unlit):
        array.setflags(write=False)
    return mesh


def _parts(index: int, item: Item) -> Iterator[_Part]:
    if isinstance(item.shape, MeshFile):
        yield from _mesh_file_parts(index, item, item.shape)
        return
    assert item.material is not None, "only mesh files bring materials of their own"
    texture = load_texture(item.material.texture) if item.material.texture else None
    patch = _placed(_patch(item.shape), item)
    yield _Part(index, patch, item.material.albedo, item.material.unlit, texture)


def _patch(shape: Box | Cylinder | Rectangle | Ring | SphereBand) -> Patch:
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


def _placed(patch: Patch, item: Item) -> Patch:
    return Patch(item.world_from_item.points(patch.corners), patch.uv)


def load_texture(path: Path) -> Texture:
    """Return an image file as (h, w, 3) uint8 sRGB. Raises ConfigError if it is none."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            texture = np.array(image.convert("RGB"))
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise ConfigError(
            Where(str(path)), key="Texture", value=str(path), expected=f"an image file ({error})"
        ) from error
    texture.setflags(write=False)
    return texture


# SAE from the two usual conventions: z up (x forward, y left) and y up (glTF: x right, z
# backwards).
_SAE_FROM_UP = {
    "z": rotation_from_rpy(np.pi, 0.0, 0.0),
    "y": np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
}


def _mesh_file_parts(index: int, item: Item, shape: MeshFile) -> Iterator[_Part]:
    for mesh in _load_meshes(shape):
        faces = np.asarray(mesh.faces)
        corners = np.asarray(mesh.vertices, dtype=np.float64)[faces] * shape.scale
        solid = np.isfinite(corners).all(axis=(1, 2))
        corners = corners[solid] @ _SAE_FROM_UP[shape.up].T
        uv, albedo, texture = _own_look(mesh, faces)
        patch = _placed(Patch(corners, uv[solid]), item)
        if item.material is None:
            yield _Part(index, patch, albedo[solid], False, texture)
        else:
            own = load_texture(item.material.texture) if item.material.texture else None
            yield _Part(index, patch, item.material.albedo, item.material.unlit, own)


def _load_meshes(shape: MeshFile) -> list[Any]:
    import trimesh

    where = Where(str(shape.path))
    if not shape.path.is_file():
        raise ConfigError(
            where, key="File", value=str(shape.path), expected="a mesh file that exists"
        )
    try:
        scene = trimesh.load_scene(shape.path, process=False)
        meshes = [mesh for mesh in scene.dump() if getattr(mesh, "faces", None) is not None]
    except Exception as error:  # readers of six formats raise whatever they like
        raise ConfigError(
            where, key="File", value=str(shape.path), expected=f"a readable mesh file ({error})"
        ) from error
    if not any(len(mesh.faces) for mesh in meshes):
        raise ConfigError(
            where, key="File", value=str(shape.path), expected="a mesh with at least one triangle"
        )
    return meshes


def _own_look(mesh: Any, faces: npt.NDArray[np.int64]) -> tuple[Floats, Floats, Texture | None]:
    """Return (n, 3, 2) uv, (n, 3) linear albedo and the texture of a loaded mesh."""
    visual = mesh.visual
    blank = np.zeros((len(faces), 3, 2))
    uv = getattr(visual, "uv", None)
    image = _texture_image(visual)
    if uv is not None and image is not None:
        # trimesh counts v from the bottom, images from the top.
        flipped = np.asarray(uv, dtype=np.float64)[faces] * (1.0, -1.0) + (0.0, 1.0)
        return flipped, np.broadcast_to(_base_colour(visual), (len(faces), 3)), image
    if uv is not None or visual.kind is None:
        return blank, np.broadcast_to(_base_colour(visual), (len(faces), 3)), None
    colours = np.asarray(visual.face_colors, dtype=np.float64)[:, :3] / 255.0
    return blank, linear_from_srgb(colours), None


def _texture_image(visual: Any) -> Texture | None:
    material = getattr(visual, "material", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is None:
        return None
    texture = np.array(image.convert("RGB"))
    texture.setflags(write=False)
    return texture


def _base_colour(visual: Any) -> Floats:
    """Return the (3,) linear base colour of a visual; mid grey where the file says nothing."""
    material = getattr(visual, "material", None)
    factor = getattr(material, "baseColorFactor", None)
    if factor is None:
        factor = getattr(material, "diffuse", None)
    if factor is None:
        return np.full(3, 0.5)
    values = np.asarray(factor, dtype=np.float64)[:3]
    return linear_from_srgb(values / 255.0 if values.max() > 1.0 else values)
