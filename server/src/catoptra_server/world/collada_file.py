"""Reader of COLLADA by pycollada: triangles, materials, unit and upward axis of the scene.

Colours are sRGB, as modelling programs write them. An opacity is A_ONE's (alpha of `transparent`
times `transparency`) or RGB_ZERO's (1 less their product). Nothing is read that a file declares as
an XML entity.

Source: COLLADA 1.4.1, Khronos 2008.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_protocol.optics.elementary import matmul
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.world.mesh_assets import (
    MID_GREY,
    WHITE,
    FileMaterial,
    FileMesh,
    Losses,
    MeshAssets,
)
from catoptra_server.world.textures import linear_light
from catoptra_server.world.world_description import Rgb

_MAX_MATERIALS, _MAX_NODES = 10_000, 200_000
# Luminance of linear sRGB, by which RGB_ZERO's colour is one number (COLLADA 1.4.1, page 7-5).
_LUMINANCE = (0.212671, 0.715160, 0.072169)


def read_collada(path: Path, assets: MeshAssets, losses: Losses) -> tuple[str, Iterator[FileMesh]]:
    """Upward axis (x, y or z) and meshes of a file, in metres.

    Args:
        path: the file.
        assets: files beside it.
        losses: what is not drawn.

    Raises:
        ConfigError: A texture is missing, no image, or exceeds the budget.
        collada.DaeError, ValueError: The file is no COLLADA.
    """
    # Imported on demand, as all readers.
    import collada

    data = path.read_bytes()
    if b"<!ENTITY" in data or b"<!DOCTYPE" in data:
        raise ValueError("it declares a document type or entities, which are not read")
    if data[:2] == b"PK":
        raise ValueError("it is an archive")
    # Broken references are left out, as by all readers of COLLADA.
    document = collada.Collada(io.BytesIO(data), ignore=[collada.common.DaeError])
    if len(document.materials) > _MAX_MATERIALS:
        raise ValueError(f"it has more than {_MAX_MATERIALS} materials")
    up = (document.assetInfo.upaxis or "Y_UP")[0].lower()
    unit = document.assetInfo.unitmeter
    root = np.diag([1.0 if unit is None else float(unit)] * 3 + [1.0])
    if document.scene is None:
        raise ValueError("it has no scene")
    return up, _read_nodes(document.scene.nodes, root, _EffectMaterials(assets, losses), losses)


def _read_nodes(
    nodes: list[Any], root: Floats, materials: _EffectMaterials, losses: Losses
) -> Iterator[FileMesh]:
    from collada import scene

    waiting = [(node, root, 0) for node in reversed(nodes)]
    count = 0
    while waiting:
        node, matrix, depth = waiting.pop()
        count += 1
        # A node of the library may be shown from several places, and so by itself.
        if count > _MAX_NODES or depth > 500:
            raise ValueError("its nodes are too many, or a node is its own ancestor")
        if isinstance(node, scene.GeometryNode):
            yield from _read_geometry(node, matrix, materials)
        elif isinstance(node, scene.ControllerNode):
            losses.add("skin or morph", "its mesh is not drawn")
        elif isinstance(node, scene.LightNode):
            losses.add("light", "it does not shine; worlds have Lights of their own")
        elif isinstance(node, scene.Node):
            inner = matmul(matrix, np.asarray(node.matrix, dtype=np.float64))
            waiting += [(child, inner, depth + 1) for child in reversed(node.children or [])]


def _read_geometry(node: Any, matrix: Floats, materials: _EffectMaterials) -> Iterator[FileMesh]:
    from collada import polygons, polylist, triangleset

    bound = {one.symbol: one.target for one in node.materials}
    for primitive in node.geometry.primitives:
        if isinstance(primitive, polylist.Polylist | polygons.Polygons):
            primitive = primitive.triangleset()
        if not isinstance(primitive, triangleset.TriangleSet) or primitive.vertex is None:
            materials.losses.add("lines", "not drawn")
            continue
        index = np.asarray(primitive.vertex_index)
        vertices = np.asarray(primitive.vertex)[index].reshape(-1, 3)
        material = materials.get(bound.get(primitive.material))
        uv, colours = None, None
        if material.texture is not None and len(primitive.texcoordset):
            at = np.asarray(primitive.texcoordset[0], dtype=np.float64)
            at = at[np.asarray(primitive.texcoord_indexset[0])].reshape(-1, at.shape[1])
            uv = at[:, :2] * (1.0, -1.0) + (0.0, 1.0)  # from the bottom to the top
        sources = primitive.sources.get("COLOR", ())
        if len(sources) and primitive.material not in bound:
            offset, source = sources[0][0], sources[0][4]
            colours = source.data[np.asarray(primitive.index)[:, :, offset]]
            colours = linear_light(colours.reshape(len(vertices), -1)[:, :3])
            material = FileMaterial(WHITE)
        faces, normals = np.arange(len(vertices)).reshape(-1, 3), None
        if primitive.normal is not None:
            normals = np.asarray(primitive.normal)[np.asarray(primitive.normal_index)]
            normals = normals.reshape(-1, 3)
        yield FileMesh(
            str(node.geometry.name or node.geometry.id),
            vertices,
            faces,
            material,
            uv,
            colours,
            normals=normals,
            file_from_mesh=matrix,
        )


class _EffectMaterials:
    """Materials of a document, each made once."""

    def __init__(self, assets: MeshAssets, losses: Losses) -> None:
        self._assets = assets
        self.losses = losses
        self._made: dict[int, FileMaterial] = {}

    def get(self, material: Any) -> FileMaterial:
        """Material of pycollada's; mid-grey for none."""
        if material is None:
            return FileMaterial()
        if id(material) not in self._made:
            self._made[id(material)] = self._make(material)
        return self._made[id(material)]

    def _make(self, material: Any) -> FileMaterial:
        effect, user = material.effect, f"material {material.name or material.id}"
        albedo, texture = MID_GREY, None
        if hasattr(effect.diffuse, "sampler"):
            albedo = WHITE
            texture = self._assets.get_texture(effect.diffuse.sampler.surface.image.path, user)
        elif effect.diffuse is not None:
            albedo = _read_colour(effect.diffuse)
        if effect.bumpmap is not None:
            self.losses.add("bump map", "surfaces are shaded without its bumps")
        if hasattr(effect.transparent, "sampler"):
            self.losses.add("texture of opacity", "surfaces are drawn opaque")
        opacity = _opacity(effect)
        emission = (0.0, 0.0, 0.0)
        if hasattr(effect.emission, "sampler"):
            self.losses.add("texture of emission", "drawn without")
        elif effect.emission is not None:
            emission = _read_colour(effect.emission)
        return FileMaterial(
            albedo,
            texture,
            emission=emission,
            two_sided=bool(effect.double_sided) or opacity < 1.0,
            opacity=opacity,
            cutoff=0.5 if opacity < 1.0 else 0.0,
            blends=opacity < 1.0,
        )


def _read_colour(colour: tuple[float, ...]) -> Rgb:
    r, g, b = linear_light(np.array(colour[:3], dtype=np.float64)).tolist()
    return r, g, b


def _opacity(effect: Any) -> float:
    """Opacity of an effect's surface; 1 for one of a texture, which is not read."""
    colour, part = effect.transparent, effect.transparency
    if colour is None:
        return 1.0
    if hasattr(colour, "sampler") or hasattr(part, "sampler"):
        return 1.0
    amount = 1.0 if part is None else float(part)
    if effect.opaque_mode == "RGB_ZERO":
        luminance = sum(k * float(v) for k, v in zip(_LUMINANCE, colour[:3], strict=True))
        return 1.0 - amount * luminance
    return amount * (float(colour[3]) if len(colour) > 3 else 1.0)
