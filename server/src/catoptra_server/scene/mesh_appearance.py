"""Appearance of a mesh as trimesh reads it: colours of corners, faces or material, texture, unlit.

Used as far as the shading model goes. Colours between the corners of a triangle are interpolated in
linear light, as glTF defines; a mesh whose triangles have one colour each has no corner colours.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.row_blocks import select_rows
from catoptra_server.scene.texture_files import Texture

Faces = npt.NDArray[np.int64]

# Colour of a surface whose file gives none: without a texture, and under one.
_MID_GREY = np.full(3, 0.5)
_WHITE = np.ones(3)
# trimesh's placeholder for a colour that an MTL file does not give.
_TRIMESH_DEFAULT_COLOUR = (102, 102, 102, 255)


class UnlitName(str):
    """Name that the reader of mesh files gives to a material that is shown whatever the lights."""

    __slots__ = ()


@dataclass(frozen=True, slots=True, eq=False)
class MeshAppearance:
    """Appearance of n triangles."""

    uv: Floats
    """(n, 3, 2) texture coordinates."""
    albedo: Floats
    """(n, 3) linear; the mean of the corners where these differ."""
    corner_albedo: Floats | None
    """(n, 3, 3) linear albedos at the corners; None for triangles of one albedo each."""
    texture: Texture | None
    """None for a mesh of plain colours."""
    unlit: bool
    """Whether the file shows the mesh at its albedo, whatever the lights."""

    def select(self, mask: Bools) -> MeshAppearance:
        """Appearance of the triangles of a (n,) mask."""
        at_corners = self.corner_albedo
        return replace(
            self,
            uv=select_rows(self.uv, mask),
            albedo=select_rows(self.albedo, mask),
            corner_albedo=None if at_corners is None else select_rows(at_corners, mask),
        )


def read_appearance(
    mesh: Any, faces: Faces, make_texture: Callable[[Any], Texture], *, is_gltf: bool
) -> MeshAppearance:
    """Appearance of a mesh of trimesh's.

    Args:
        mesh: the mesh.
        faces: (n, 3) vertices of the triangles, in the order of the corners.
        make_texture: texture of an image of Pillow's.
        is_gltf: whether colours are linear; those of other files are sRGB.
    """
    visual = mesh.visual
    material = getattr(visual, "material", None)
    unlit = isinstance(getattr(material, "name", None), UnlitName)
    uv, image = getattr(visual, "uv", None), _texture_image(material)
    if uv is None or image is None:
        albedo, corner_albedo = _plain_albedo(visual, material, faces, is_gltf=is_gltf)
        return MeshAppearance(
            no_texture_coordinates(len(faces)), albedo, corner_albedo, None, unlit
        )
    base = _base_colour(material, _WHITE, is_gltf=is_gltf)
    albedo, corner_albedo = _tinted_albedo(base, visual, faces, is_gltf=is_gltf)
    # trimesh counts v from the bottom, images count rows from the top.
    flipped = np.asarray(uv, dtype=np.float64) * (1.0, -1.0) + (0.0, 1.0)
    corner_uv = flipped.take(faces, axis=0)
    return MeshAppearance(corner_uv, albedo, corner_albedo, make_texture(image), unlit)


def no_texture_coordinates(num_triangles: int) -> Floats:
    """(n, 3, 2) zeros that take no memory, for triangles without a texture."""
    return np.broadcast_to(0.0, (num_triangles, 3, 2))


def _plain_albedo(
    visual: Any, material: Any, faces: Faces, *, is_gltf: bool
) -> tuple[Floats, Floats | None]:
    """(n, 3) albedos of triangles without a texture, and those at their corners."""
    if material is not None or visual.kind is None:
        base = _base_colour(material, _MID_GREY, is_gltf=is_gltf)
        return _tinted_albedo(base, visual, faces, is_gltf=is_gltf)
    if visual.kind == "vertex":
        return _corner_albedos(_linear_light(visual.vertex_colors, is_gltf=is_gltf), faces)
    return _linear_light(visual.face_colors, is_gltf=is_gltf), None


def _tinted_albedo(
    base: Floats, visual: Any, faces: Faces, *, is_gltf: bool
) -> tuple[Floats, Floats | None]:
    """(n, 3) albedos of a material's base colour times the colours at vertices, if there are any.

    Source: glTF 2.0, 3.7.2.1: COLOR_0 multiplies the base colour.
    """
    attributes = getattr(visual, "vertex_attributes", None)
    if attributes is None or "color" not in attributes:
        return np.broadcast_to(base, (len(faces), 3)), None
    return _corner_albedos(base * _linear_light(attributes["color"], is_gltf=is_gltf), faces)


def _corner_albedos(vertex_albedo: Floats, faces: Faces) -> tuple[Floats, Floats | None]:
    """(n, 3) mean albedos of triangles with (v, 3) albedos at vertices, and those at corners."""
    corners = vertex_albedo.take(faces, axis=0)
    first, second, third = np.moveaxis(corners, 1, 0)
    if (first == second).all() and (first == third).all():
        return first.copy(), None  # a copy: the view would keep all corners
    return (first + second + third) / 3.0, corners


def _texture_image(material: Any) -> Any:
    """Image of a material as Pillow has it, not decoded yet; None without one."""
    return getattr(material, "baseColorTexture", None) or getattr(material, "image", None)


def _base_colour(material: Any, default: Floats, *, is_gltf: bool) -> Floats:
    """(3,) linear base colour of a material; the default for a file that gives none."""
    factor = getattr(material, "baseColorFactor", None)
    if factor is None:
        factor = getattr(material, "diffuse", None)
    if factor is None or tuple(factor) == _TRIMESH_DEFAULT_COLOUR:
        return default
    return _linear_light(factor, is_gltf=is_gltf)


def _linear_light(colours: npt.ArrayLike, *, is_gltf: bool) -> Floats:
    """(..., 3) linear light of (..., 3 or 4) colours: glTF's are linear, those of others sRGB.

    Whole numbers are fractions of the largest one of their type; fractions beyond [0, 1] and NaN
    are clipped. Source: glTF 2.0, 3.9.2 and 3.7.2.1: baseColorFactor and COLOR_0 are linear.
    """
    values = np.asarray(colours)[..., :3]
    if values.dtype == np.uint8:
        return _linear_table(is_gltf=is_gltf).take(values)
    limit = np.iinfo(values.dtype).max if values.dtype.kind in "iu" else 1.0
    fractions = np.clip(np.nan_to_num(values.astype(np.float64) / limit), 0.0, 1.0)
    return fractions if is_gltf else linear_from_srgb(fractions)


def _linear_table(*, is_gltf: bool) -> Floats:
    """(256,) linear light of each byte: a look-up is a hundred times as fast as the power."""
    fractions = np.arange(256) / 255.0
    return fractions if is_gltf else linear_from_srgb(fractions)
