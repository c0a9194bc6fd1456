"""Mesh files (GLB, glTF, OBJ, PLY, STL, DAE) as triangles in SAE; the only module that imports
trimesh.

A file's own appearance is used as far as the shading model goes: a texture or a colour, of the
material or of the faces.
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
# Both renderers square coordinates in float32, whose range ends at 3e38.
_MAX_COORDINATE_M = 1e15
# With more repetitions float32 cannot resolve a position within the texture.
_MAX_TEXTURE_REPEATS = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class LoadedMesh:
    """Mesh of one appearance, n triangles."""

    patch: Patch
    albedo: Floats
    """(n, 3) linear."""
    texture: Texture | None
    """None for a mesh of plain colours."""


# SAE from the two usual conventions: z up (x forward, y left), and y up (glTF: x right, z
# backwards).
_SAE_FROM_UP = {
    "z": rotation_from_rpy(np.pi, 0.0, 0.0),
    "y": np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
}


def load_mesh_file(shape: MeshFile) -> list[LoadedMesh]:
    """Load the meshes of a file, scaled and rotated into SAE.

    Raises:
        ConfigError: The file is missing, unreadable, or without a triangle.
    """
    # Imported on demand: loading trimesh takes a second, reading and building the corridor 0.3 s.
    import trimesh

    if not shape.path.is_file():
        raise _mesh_file_error(shape, "a mesh file that exists")
    try:
        # process=False: no merging of vertices, which would change texture coordinates at seams.
        scene = trimesh.load_scene(shape.path, process=False)
        # A scene may hold point clouds and paths, which have no faces.
        surfaces = [mesh for mesh in scene.dump() if getattr(mesh, "faces", None) is not None]
        meshes = [_convert_mesh(mesh, shape) for mesh in surfaces]
    except Exception as error:  # readers of six formats raise many types
        raise _mesh_file_error(shape, f"a readable mesh file ({error})") from error
    if not any(len(mesh.patch.corners) for mesh in meshes):
        raise _mesh_file_error(shape, "a mesh with at least one triangle")
    return meshes


def _mesh_file_error(shape: MeshFile, expected: str) -> ConfigError:
    path = str(shape.path)
    return ConfigError(SourceLocation(path), key="File", value=path, expected=expected)


def _convert_mesh(mesh: Any, shape: MeshFile) -> LoadedMesh:
    """Convert a mesh of trimesh's, without triangles that cannot be rendered.

    Triangles without area show nothing and are dropped silently; triangles without finite positions
    or texture coordinates are a defect of the file and logged.
    """
    faces = np.asarray(mesh.faces)
    corners = np.asarray(mesh.vertices, dtype=np.float64)[faces] * shape.scale
    is_gltf = shape.path.suffix.lower() in (".glb", ".gltf")
    uv, albedo, texture = _read_appearance(mesh, faces, is_gltf=is_gltf)
    valid = _is_within_bound(
        corners, _MAX_COORDINATE_M, "a corner without a finite position", shape
    )
    valid &= _is_within_bound(
        uv, _MAX_TEXTURE_REPEATS, "texture coordinates that are no finite numbers", shape
    )
    valid[valid] = _has_area(corners[valid])
    patch = Patch(corners[valid] @ _SAE_FROM_UP[shape.up].T, uv[valid])
    return LoadedMesh(patch, albedo[valid], texture)


def _is_within_bound(
    values: Floats, max_value: float, defect: str, shape: MeshFile
) -> npt.NDArray[np.bool_]:
    """(n,) triangles whose (n, 3, k) values all lie within a bound; logs the others."""
    # Comparisons with NaN are false, so NaN counts as out of bounds.
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
    """(n,) triangles of (n, 3, 3) with an area, however small."""
    edges = corners[:, 1:] - corners[:, :1]
    # Relative to the longest edge: the product of two tiny edges would underflow.
    size = np.abs(edges).max(axis=(1, 2), initial=0.0)[:, None, None]
    edges = edges / np.where(size > 0.0, size, 1.0)
    return np.asarray((np.cross(edges[:, 0], edges[:, 1]) != 0.0).any(axis=-1))


def _read_appearance(
    mesh: Any, faces: npt.NDArray[np.int64], *, is_gltf: bool
) -> tuple[Floats, Floats, Texture | None]:
    """(n, 3, 2) uv, (n, 3) linear albedo and the texture of a loaded mesh."""
    visual, no_uv = mesh.visual, np.zeros((len(faces), 3, 2))
    material = getattr(visual, "material", None)
    if material is None and visual.kind is not None:
        return no_uv, _linear_light(visual.face_colors, is_gltf=is_gltf), None
    uv, texture = getattr(visual, "uv", None), _texture_image(material)
    if uv is None or texture is None:
        return (
            no_uv,
            _repeat_per_face(_base_colour(material, _MID_GREY, is_gltf=is_gltf), faces),
            None,
        )
    # trimesh counts v from the bottom, images count rows from the top.
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


# Colour of a surface whose file gives none: without a texture, and under one.
_MID_GREY = np.full(3, 0.5)
_WHITE = np.ones(3)
# trimesh's placeholder for a colour that an MTL file does not give.
_TRIMESH_DEFAULT_COLOUR = (102, 102, 102, 255)


def _base_colour(material: Any, default: Floats, *, is_gltf: bool) -> Floats:
    """(3,) linear base colour of a material; the default for a file that gives none."""
    factor = getattr(material, "baseColorFactor", None)
    if factor is None:
        factor = getattr(material, "diffuse", None)
    if factor is None or tuple(factor) == _TRIMESH_DEFAULT_COLOUR:
        return default
    return _linear_light(factor, is_gltf=is_gltf)


def _linear_light(colours: npt.NDArray[np.uint8], *, is_gltf: bool) -> Floats:
    """(..., 3) linear light of (..., 4) bytes: glTF's numbers are linear, those of others sRGB.

    Source: glTF 2.0, 3.9.2 and 3.7.2.1: baseColorFactor and COLOR_0 are linear.
    """
    values = np.asarray(colours, dtype=np.float64)[..., :3] / 255.0
    return values if is_gltf else linear_from_srgb(values)
