"""Mesh files (GLB, glTF, OBJ, PLY, STL, DAE) as triangles in SAE; the only module that imports
trimesh.

A million triangles are read in some 0.3 s: vertices are scaled and rotated before their triangles
are formed, and no array is copied to leave out triangles where all can be rendered.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sized
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.memory_budget import BYTES_PER_TRIANGLE, MemoryBudget
from catoptra_server.scene.facets import facet_normals
from catoptra_server.scene.gltf_sizes import reserve_gltf
from catoptra_server.scene.mesh_appearance import (
    MeshAppearance,
    UnlitName,
    read_appearance,
)
from catoptra_server.scene.mesh_assets import MeshAssets
from catoptra_server.scene.row_blocks import gather_rows, row_blocks, select_rows
from catoptra_server.scene.texture_files import Texture, decode_image, reserve_texels
from catoptra_server.scene.triangle_files import read_triangle_file
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

    corners: Floats
    """(n, 3, 3) metres, SAE."""
    normals: Floats
    """(n, 3) unit, by the winding."""
    appearance: MeshAppearance
    node: str = ""
    """Node of a glTF file; empty for other formats."""


# SAE from the two usual conventions: z up (x forward, y left), and y up (glTF: x right, z
# backwards). Which coordinate of the file is x, y and z, and its sign.
_SAE_FROM_UP: dict[str, tuple[slice | list[int], tuple[float, float, float]]] = {
    "z": (slice(None), (1.0, -1.0, -1.0)),
    "y": ([2, 0, 1], (-1.0, 1.0, -1.0)),
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
        meshes = list(_load_meshes(shape, memory))
    except ConfigError:
        raise
    except Exception as error:  # readers of six formats raise many types
        raise _mesh_file_error(shape, f"a readable mesh file ({error})") from error
    if not any(len(mesh.corners) for mesh in meshes):
        raise _mesh_file_error(
            shape,
            "a mesh with at least one triangle that has an area and corners within "
            f"{_MAX_COORDINATE_M:g} m at Scale={shape.scale:g}",
        )
    return meshes


def _load_meshes(shape: MeshFile, memory: MemoryBudget) -> Iterator[LoadedMesh]:
    """Yield the meshes of a file; sizes that the file announces are checked first."""
    path, where = shape.path, SourceLocation(str(shape.path))
    num_bytes = path.stat().st_size
    reading = memory.for_reading()
    reading.reserve(
        _READ_BYTES_PER_FILE_BYTE * num_bytes,
        where=where,
        key="File",
        value=f"{num_bytes} bytes",
        remedy="a smaller mesh file",
    )
    mesh = read_triangle_file(path)
    if mesh is None:
        yield from _convert_scene(_read_scene(path, reading), shape, memory)
        return
    _reserve_triangles(mesh.faces, path.stem, memory, where)
    yield _convert_mesh(mesh, shape, np.eye(4), _reject_image)


def _reject_image(image: Any) -> Texture:
    raise AssertionError(f"a file of nothing but triangles has no image such as {image}")


def _read_scene(path: Path, memory: MemoryBudget) -> Any:
    """trimesh's scene of a file; arrays and images that the file announces are checked first."""
    # Imported on demand: loading trimesh takes longer than most files.
    import trimesh
    from trimesh.exchange.gltf.extensions import register_handler

    # trimesh drops unknown extensions of a material, and keeps its name, which nothing else needs.
    register_handler("KHR_materials_unlit", scope="material")(
        lambda _: {"name": UnlitName("unlit")}
    )

    where = SourceLocation(str(path))
    assets = MeshAssets(path.parent, memory)
    if path.suffix.lower() in _GLTF_SUFFIXES:
        data = path.read_bytes()
        _require_whole(data)
        reserve_gltf(data, memory, where, assets.get)
    try:
        # process=False: no merging of vertices, which would change texture coordinates at seams.
        scene = trimesh.load_scene(path, resolver=assets, process=False)
    finally:
        # trimesh goes on without an image that it cannot read.
        if assets.rejection is not None:
            raise assets.rejection
    for name in dict.fromkeys(assets.missing):
        _LOG.warning("%s: it is drawn without %s: there is no such file beside it", path, name)
    return scene


def _require_whole(data: bytes) -> None:
    """Raise ValueError for a GLB file that is shorter than it states."""
    if not data:
        raise ValueError("it is empty")
    stated = int.from_bytes(data[8:12], "little")
    if data[:4] == b"glTF" and len(data) < stated:
        raise ValueError(f"it is cut off: {len(data)} of {stated} bytes")


def _convert_scene(scene: Any, shape: MeshFile, memory: MemoryBudget) -> Iterator[LoadedMesh]:
    """Yield the meshes of a scene at their positions."""
    textures: dict[int, Texture] = {}  # by the image's identity: meshes may share an image
    is_gltf = shape.path.suffix.lower() in _GLTF_SUFFIXES
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
        _reserve_triangles(mesh.faces, name, memory, where)
        converted = _convert_mesh(mesh, shape, world_from_mesh, make_texture)
        yield replace(converted, node=str(node)) if is_gltf else converted


def _reserve_triangles(
    faces: Sized, name: str, memory: MemoryBudget, where: SourceLocation
) -> None:
    memory.reserve(
        BYTES_PER_TRIANGLE * len(faces),
        where=where,
        key="File",
        value=f"mesh {name} of {len(faces)} triangles",
        remedy="fewer triangles",
    )


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
    # A mirrored copy is wound the other way round: its triangles would face inwards.
    if np.linalg.det(world_from_mesh[:3, :3]) < 0.0:
        faces = faces[:, ::-1]
    is_gltf = shape.path.suffix.lower() in _GLTF_SUFFIXES
    appearance = read_appearance(mesh, faces, make_texture, is_gltf=is_gltf)
    corners = gather_rows(_sae_vertices(mesh, shape, world_from_mesh), faces)
    valid = _is_within_bound(
        corners, _MAX_COORDINATE_M, f"a corner beyond {_MAX_COORDINATE_M:g} m or no number", shape
    )
    if appearance.texture is not None:
        valid &= _is_within_bound(
            appearance.uv,
            _MAX_TEXTURE_REPEATS,
            "texture coordinates that are no finite numbers",
            shape,
        )
    corners, appearance = select_rows(corners, valid), appearance.select(valid)
    normals, has_area = facet_normals(corners)
    return LoadedMesh(
        select_rows(corners, has_area), select_rows(normals, has_area), appearance.select(has_area)
    )


def _sae_vertices(mesh: Any, shape: MeshFile, world_from_mesh: Floats) -> Floats:
    """(v, 3) vertices of a mesh, metres, SAE; infinite or no numbers where the file's are."""
    vertices = np.asarray(mesh.vertices)
    with np.errstate(invalid="ignore", over="ignore"):
        if not np.array_equal(world_from_mesh, np.eye(4)):
            vertices = (
                vertices.astype(np.float64) @ world_from_mesh[:3, :3].T + world_from_mesh[:3, 3]
            )
        order, signs = _SAE_FROM_UP[shape.up]
        sae: Floats = vertices[:, order] * (shape.scale * np.array(signs))
        return sae


def _is_within_bound(values: Floats, max_value: float, defect: str, shape: MeshFile) -> Bools:
    """(n,) triangles whose (n, 3, k) values all lie within a bound; logs the others."""
    within = np.ones(len(values), dtype=bool)
    for block in row_blocks(len(values)):
        # Comparisons with NaN are false, so NaN counts as out of bounds.
        is_within = np.abs(values[block]) <= max_value
        if not is_within.all():
            within[block] = is_within.all(axis=(1, 2))
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


def _load_image(
    image: Any, textures: dict[int, Texture], memory: MemoryBudget, where: SourceLocation
) -> Texture:
    """Texture of an image, decoded once."""
    if id(image) not in textures:
        reserve_texels(image.size, memory, where)
        textures[id(image)] = decode_image(image, where)
    return textures[id(image)]
