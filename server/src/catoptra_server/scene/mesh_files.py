"""Mesh files (GLB, glTF, OBJ, PLY, STL, DAE) as triangles in SAE; the only module that imports
trimesh.

A file's own appearance is used as far as the shading model goes: a texture or a colour, of the
material or of the faces.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import rotation_from_rpy
from catoptra_server.memory_budget import BYTES_PER_TRIANGLE, MemoryBudget
from catoptra_server.scene.colour import linear_from_srgb
from catoptra_server.scene.gltf_sizes import reserve_gltf
from catoptra_server.scene.mesh_assets import MeshAssets
from catoptra_server.scene.primitives import Patch
from catoptra_server.scene.texture_files import Texture, decode_image, reserve_texels
from catoptra_server.scene.world_description import MeshFile

_LOG = logging.getLogger(__name__)
# Ten times the largest coordinate of a world's file. A float32 has steps of 6 cm there.
_MAX_COORDINATE_M = 1e6
# Readers of further formats (archives, CAD files) exist in trimesh; none of them is bounded.
_GLTF_SUFFIXES = (".glb", ".gltf")
_SUFFIXES = (*_GLTF_SUFFIXES, ".obj", ".ply", ".stl", ".dae")
# While a file is read: lines of an OBJ or elements of a DAE are objects of Python.
_READ_BYTES_PER_FILE_BYTE = 10
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


def load_mesh_file(shape: MeshFile, memory: MemoryBudget | None = None) -> list[LoadedMesh]:
    """Load the meshes of a file, scaled and rotated into SAE.

    Args:
        shape: the file with its scale and its axis.
        memory: budget of the scene; None for a budget of this file's own.

    Raises:
        ConfigError: The file is missing, unreadable, without a triangle, or larger than the budget.
    """
    if not shape.path.is_file():
        raise _mesh_file_error(shape, "a mesh file that exists")
    if shape.path.suffix.lower() not in _SUFFIXES:
        raise _mesh_file_error(shape, f"a mesh file of a known format: {', '.join(_SUFFIXES)}")
    memory = memory or MemoryBudget()
    try:
        meshes = list(_convert_scene(_read_scene(shape.path, memory.for_reading()), shape, memory))
    except ConfigError:
        raise
    except Exception as error:  # readers of six formats raise many types
        raise _mesh_file_error(shape, f"a readable mesh file ({error})") from error
    if not any(len(mesh.patch.corners) for mesh in meshes):
        raise _mesh_file_error(shape, "a mesh with at least one triangle")
    return meshes


def _read_scene(path: Path, memory: MemoryBudget) -> Any:
    """trimesh's scene of a file; sizes that the file announces are checked first."""
    # Imported on demand: loading trimesh takes a second, reading and building the corridor 0.3 s.
    import trimesh

    where, num_bytes = SourceLocation(str(path)), path.stat().st_size
    memory.reserve(
        _READ_BYTES_PER_FILE_BYTE * num_bytes,
        where=where,
        key="File",
        value=f"{num_bytes} bytes",
        remedy="a smaller mesh file",
    )
    assets = MeshAssets(path.parent, memory)
    if path.suffix.lower() in _GLTF_SUFFIXES:
        reserve_gltf(path.read_bytes(), memory, where, assets.get)
    try:
        # process=False: no merging of vertices, which would change texture coordinates at seams.
        return trimesh.load_scene(path, resolver=assets, process=False)
    finally:
        # trimesh logs an image that it cannot read, and goes on without.
        if assets.rejection is not None:
            raise assets.rejection


def _convert_scene(scene: Any, shape: MeshFile, memory: MemoryBudget) -> Iterator[LoadedMesh]:
    """Yield the meshes of a scene at their positions."""
    textures: dict[int, Texture] = {}  # by the image's identity: meshes may share an image
    where = SourceLocation(str(shape.path))

    def make_texture(image: Any) -> Texture:
        return _load_image(image, textures, memory, where)

    # Not scene.dump(), which copies each mesh with its image before its size is known here.
    for node in scene.graph.nodes_geometry:
        world_from_mesh, name = scene.graph[node]
        mesh = scene.geometry[name]
        # A scene may hold point clouds and paths, which have no faces.
        if getattr(mesh, "faces", None) is None:
            continue
        memory.reserve(
            BYTES_PER_TRIANGLE * len(mesh.faces),
            where=where,
            key="File",
            value=f"mesh {name} of {len(mesh.faces)} triangles",
            remedy="fewer triangles",
        )
        yield _convert_mesh(mesh, shape, world_from_mesh, make_texture)


def _mesh_file_error(shape: MeshFile, expected: str) -> ConfigError:
    path = str(shape.path)
    return ConfigError(SourceLocation(path), key="File", value=path, expected=expected)


def _convert_mesh(
    mesh: Any, shape: MeshFile, world_from_mesh: Floats, make_texture: Callable[[Any], Texture]
) -> LoadedMesh:
    """Convert a mesh of trimesh's, without triangles that cannot be rendered.

    Triangles without area show nothing and are dropped silently; triangles without finite positions
    or texture coordinates are a defect of the file and logged.

    Args:
        mesh: a mesh of trimesh's.
        shape: the file with its scale and its axis.
        world_from_mesh: (4, 4) position of the mesh in its file.
        make_texture: texture of an image of Pillow's.
    """
    faces = np.asarray(mesh.faces)
    rotation, translation = world_from_mesh[:3, :3], world_from_mesh[:3, 3]
    # Vertices may be infinite or no numbers: their triangles are dropped below.
    with np.errstate(invalid="ignore", over="ignore"):
        vertices = np.asarray(mesh.vertices, dtype=np.float64) @ rotation.T + translation
        corners = vertices[faces] * shape.scale
    is_gltf = shape.path.suffix.lower() in _GLTF_SUFFIXES
    uv, albedo, texture = _read_appearance(mesh, faces, make_texture, is_gltf=is_gltf)
    # A mirrored copy is wound the other way round: its triangles would face inwards.
    if np.linalg.det(rotation) < 0.0:
        corners, uv = corners[:, ::-1], uv[:, ::-1]
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
    mesh: Any,
    faces: npt.NDArray[np.int64],
    make_texture: Callable[[Any], Texture],
    *,
    is_gltf: bool,
) -> tuple[Floats, Floats, Texture | None]:
    """(n, 3, 2) uv, (n, 3) linear albedo and the texture of a loaded mesh."""
    visual, no_uv = mesh.visual, np.zeros((len(faces), 3, 2))
    material = getattr(visual, "material", None)
    if material is None and visual.kind is not None:
        return no_uv, _linear_light(visual.face_colors, is_gltf=is_gltf), None
    uv, image = getattr(visual, "uv", None), _texture_image(material)
    if uv is None or image is None:
        return (
            no_uv,
            _repeat_per_face(_base_colour(material, _MID_GREY, is_gltf=is_gltf), faces),
            None,
        )
    # trimesh counts v from the bottom, images count rows from the top.
    flipped = np.asarray(uv, dtype=np.float64)[faces] * (1.0, -1.0) + (0.0, 1.0)
    albedo = _base_colour(material, _WHITE, is_gltf=is_gltf)
    return flipped, _repeat_per_face(albedo, faces), make_texture(image)


def _repeat_per_face(colour: Floats, faces: npt.NDArray[np.int64]) -> Floats:
    return np.broadcast_to(colour, (len(faces), 3))


def _texture_image(material: Any) -> Any:
    """Image of a material as Pillow has it, not decoded yet; None without one."""
    return getattr(material, "baseColorTexture", None) or getattr(material, "image", None)


def _load_image(
    image: Any, textures: dict[int, Texture], memory: MemoryBudget, where: SourceLocation
) -> Texture:
    """Texture of an image, decoded once."""
    if id(image) not in textures:
        reserve_texels(image.size, memory, where)
        textures[id(image)] = decode_image(image, where)
    return textures[id(image)]


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
