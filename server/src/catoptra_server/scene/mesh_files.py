"""Mesh files (GLB, glTF, OBJ, PLY, STL, DAE) as triangles in SAE; the one door to trimesh.

A file's own look is taken as far as the shading model goes: a texture or a colour, of the material
or of the faces.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import rotation_from_rpy
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.primitives import Patch
from catoptra_server.scene.world_description import MeshFile

Texture = npt.NDArray[np.uint8]  # (h, w, 3) sRGB, row 0 at the top

_LOG = logging.getLogger(__name__)
# Both renderers square places in float32, which ends at 3e38.
_MAX_COORDINATE_M = 1e15
# Beyond so many repetitions float32 cannot tell one place of a texture from another.
_MAX_TEXTURE_REPEATS = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class LoadedMesh:
    """A mesh of one look: n triangles, their (n, 3) linear albedo, the texture if it has one."""

    patch: Patch
    albedo: Floats
    texture: Texture | None


# SAE from the two usual conventions: z up (x forward, y left) and y up (glTF: x right, z
# backwards).
_SAE_FROM_UP = {
    "z": rotation_from_rpy(np.pi, 0.0, 0.0),
    "y": np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
}


def load_mesh_file(shape: MeshFile) -> list[LoadedMesh]:
    """Return the meshes of a file, scaled and turned; ConfigError if it has no triangle."""
    import trimesh

    if not shape.path.is_file():
        raise _mesh_file_error(shape, "a mesh file that exists")
    try:
        scene = trimesh.load_scene(shape.path, process=False)
        solid = [mesh for mesh in scene.dump() if getattr(mesh, "faces", None) is not None]
        meshes = [_convert_mesh(mesh, shape) for mesh in solid]
    except Exception as error:  # readers of six formats raise whatever they like
        raise _mesh_file_error(shape, f"a readable mesh file ({error})") from error
    if not any(len(mesh.patch.corners) for mesh in meshes):
        raise _mesh_file_error(shape, "a mesh with at least one triangle")
    return meshes


def _mesh_file_error(shape: MeshFile, expected: str) -> ConfigError:
    path = str(shape.path)
    return ConfigError(SourceLocation(path), key="File", value=path, expected=expected)


def _convert_mesh(mesh: Any, shape: MeshFile) -> LoadedMesh:
    """Return a mesh of trimesh's as ours, without triangles that cannot be drawn.

    Those without area show nothing and go in silence; those without a place, or without a place on
    their texture, are a fault of the file that a warning names.
    """
    faces = np.asarray(mesh.faces)
    corners = np.asarray(mesh.vertices, dtype=np.float64)[faces] * shape.scale
    is_gltf = shape.path.suffix.lower() in (".glb", ".gltf")
    uv, albedo, texture = _read_appearance(mesh, faces, is_gltf=is_gltf)
    kept = _is_within_bound(corners, _MAX_COORDINATE_M, "a corner without a finite place", shape)
    kept &= _is_within_bound(
        uv, _MAX_TEXTURE_REPEATS, "texture coordinates that are no finite numbers", shape
    )
    kept[kept] = _has_area(corners[kept])
    patch = Patch(corners[kept] @ _SAE_FROM_UP[shape.up].T, uv[kept])
    return LoadedMesh(patch, albedo[kept], texture)


def _is_within_bound(
    values: Floats, max_value: float, defect: str, shape: MeshFile
) -> npt.NDArray[np.bool_]:
    """Return which of n triangles have all (n, 3, k) values within a bound; warn of others."""
    # A comparison with NaN is false.
    within = np.asarray((np.abs(values) <= max_value).all(axis=(1, 2)))
    wrong = np.flatnonzero(~within)
    if len(wrong):
        _LOG.warning(
            "%s: left out %d of %d triangles with %s, the first is number %d",
            shape.path,
            len(wrong),
            len(within),
            defect,
            wrong[0],
        )
    return within


def _has_area(corners: Floats) -> npt.NDArray[np.bool_]:
    """Return which of (n, 3, 3) triangles have an area; how small it is does not matter."""
    edges = corners[:, 1:] - corners[:, :1]
    # Over the longest edge, so that the product of tiny edges does not vanish.
    size = np.abs(edges).max(axis=(1, 2), initial=0.0)[:, None, None]
    edges = edges / np.where(size > 0.0, size, 1.0)
    return np.asarray((np.cross(edges[:, 0], edges[:, 1]) != 0.0).any(axis=-1))


def _read_appearance(
    mesh: Any, faces: npt.NDArray[np.int64], *, is_gltf: bool
) -> tuple[Floats, Floats, Texture | None]:
    """Return (n, 3, 2) uv, (n, 3) linear albedo and the texture of a loaded mesh."""
    visual, blank = mesh.visual, np.zeros((len(faces), 3, 2))
    material = getattr(visual, "material", None)
    if material is None and visual.kind is not None:
        return blank, _linear_light(visual.face_colors, is_gltf=is_gltf), None
    uv, texture = getattr(visual, "uv", None), _texture_image(material)
    if uv is None or texture is None:
        return (
            blank,
            _repeat_per_face(_base_colour(material, _MID_GREY, is_gltf=is_gltf), faces),
            None,
        )
    # trimesh counts v from the bottom, images from the top.
    flipped = np.asarray(uv, dtype=np.float64)[faces] * (1.0, -1.0) + (0.0, 1.0)
    albedo = _base_colour(material, _WHITE, is_gltf=is_gltf)
    return flipped, _repeat_per_face(albedo, faces), texture


def _repeat_per_face(colour: Floats, faces: npt.NDArray[np.int64]) -> Floats:
    return np.broadcast_to(colour, (len(faces), 3))


def _texture_image(material: Any) -> Texture | None:
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is None:
        return None
    texture = np.array(image.convert("RGB"))
    texture.setflags(write=False)
    return texture


# What a surface is where its file does not say: without a texture, and under one.
_MID_GREY = np.full(3, 0.5)
_WHITE = np.ones(3)
# What trimesh puts for a colour that an MTL file does not give.
_TRIMESH_DEFAULT_COLOUR = (102, 102, 102, 255)


def _base_colour(material: Any, default: Floats, *, is_gltf: bool) -> Floats:
    """Return the (3,) linear base colour of a material; `unknown` where the file says nothing."""
    factor = getattr(material, "baseColorFactor", None)
    if factor is None:
        factor = getattr(material, "diffuse", None)
    if factor is None or tuple(factor) == _TRIMESH_DEFAULT_COLOUR:
        return default
    return _linear_light(factor, is_gltf=is_gltf)


def _linear_light(colours: npt.NDArray[np.uint8], *, is_gltf: bool) -> Floats:
    """Return (..., 3) linear light of (..., 4) bytes: glTF's numbers are linear, others' sRGB.

    Source: glTF 2.0, 3.9.2 and 3.7.2.1: baseColorFactor and COLOR_0 are linear.
    """
    values = np.asarray(colours, dtype=np.float64)[..., :3] / 255.0
    return values if is_gltf else linear_from_srgb(values)
