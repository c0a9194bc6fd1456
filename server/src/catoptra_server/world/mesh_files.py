"""Mesh files (GLB, glTF, OBJ, PLY, STL, DAE) as triangles in SAE; no other module imports trimesh.

A million triangles are read in some 0.3 s: vertices are scaled and rotated before their triangles
are formed, and no array is copied to leave out triangles where all can be rendered.

Binary PLY and STL files of nothing but triangles are read without trimesh, in 0.3 s in place of
2.8: these are the formats of scanned and generated meshes, which are often large, and their arrays
lie in the file as they are needed. Loading trimesh alone takes 0.1 to 0.15 s. Whatever these
readers do not know, damaged files too, is left to trimesh.

Sources: G. Turk, "The PLY Polygon File Format", 1994; 3D Systems, "StereoLithography Interface
Specification", 1989.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sized
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.optics.elementary import matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.runtime.memory import BYTES_PER_TRIANGLE, MemoryBudget
from catoptra_server.world.mesh_assets import MeshAssets, reserve_gltf
from catoptra_server.world.scene_mesh import MeshPart
from catoptra_server.world.shapes import facet_normals
from catoptra_server.world.textures import (
    Texture,
    UnlitName,
    decode_image,
    read_appearance,
    reserve_texels,
)
from catoptra_server.world.triangles import gather_rows, row_blocks, select_rows
from catoptra_server.world.world_description import MeshFile

log = logging.getLogger(__name__)
# Ten times the largest coordinate of a world's file. A float32 has steps of 6 cm there.
_MAX_COORDINATE_M = 1e6
# Readers of further formats (archives, CAD files) exist in trimesh; their memory has no bound.
_GLTF_SUFFIXES = (".glb", ".gltf")
_SUFFIXES = (*_GLTF_SUFFIXES, ".obj", ".ply", ".stl", ".dae")
# While a file is read: lines of an OBJ or elements of a DAE are objects of Python.
_READ_BYTES_PER_FILE_BYTE = 10
# With more repetitions float32 cannot resolve a position within the texture.
_MAX_TEXTURE_REPEATS = 1e6

# SAE from the two usual conventions: z up (x forward, y left), and y up (glTF: x right, z
# backwards). Which coordinate of the file is x, y and z, and its sign.
_SAE_FROM_UP: dict[str, tuple[slice | list[int], tuple[float, float, float]]] = {
    "z": (slice(None), (1.0, -1.0, -1.0)),
    "y": ([2, 0, 1], (-1.0, 1.0, -1.0)),
}


def load_mesh_file(shape: MeshFile, memory: MemoryBudget | None = None) -> list[MeshPart]:
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


def _load_meshes(shape: MeshFile, memory: MemoryBudget) -> Iterator[MeshPart]:
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
        log.warning("%s: it is drawn without %s: there is no such file beside it", path, name)
    return scene


def _require_whole(data: bytes) -> None:
    """Raise ValueError for a GLB file that is shorter than it states."""
    if not data:
        raise ValueError("it is empty")
    stated = int.from_bytes(data[8:12], "little")
    if data[:4] == b"glTF" and len(data) < stated:
        raise ValueError(f"it is cut off: {len(data)} of {stated} bytes")


def _convert_scene(scene: Any, shape: MeshFile, memory: MemoryBudget) -> Iterator[MeshPart]:
    """Yield the meshes of a scene at their positions."""
    textures: dict[int, Texture] = {}  # by the image's identity: meshes may share an image
    is_gltf = shape.path.suffix.lower() in _GLTF_SUFFIXES
    where = SourceLocation(str(shape.path))

    def make_texture(image: Any) -> Texture:
        if id(image) not in textures:
            reserve_texels(image.size, memory, where)
            textures[id(image)] = decode_image(image, where)
        return textures[id(image)]

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
) -> MeshPart:
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
    return MeshPart(
        select_rows(corners, has_area), select_rows(normals, has_area), appearance.select(has_area)
    )


def _sae_vertices(mesh: Any, shape: MeshFile, world_from_mesh: Floats) -> Floats:
    """(v, 3) vertices of a mesh, metres, SAE; infinite or no numbers where the file's are."""
    vertices = np.asarray(mesh.vertices)
    with np.errstate(invalid="ignore", over="ignore"):
        if not np.array_equal(world_from_mesh, np.eye(4)):
            vertices = (
                matmul(vertices.astype(np.float64), world_from_mesh[:3, :3].T)
                + world_from_mesh[:3, 3]
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
        log.warning(
            "%s: left out %d of %d triangles with %s, the first is number %d",
            shape.path,
            len(wrong),
            len(within),
            defect,
            wrong[0],
        )
    return within


@dataclass(frozen=True, slots=True, eq=False)
class _VertexColours:
    """Appearance in the form that trimesh gives it: colours at vertices, or none."""

    kind: str | None
    """`vertex`, or None without colours."""
    vertex_colors: npt.NDArray[np.uint8] | None
    """(v, 3) sRGB."""


@dataclass(frozen=True, slots=True, eq=False)
class _TriangleMesh:
    """Mesh in the form that trimesh gives it."""

    vertices: npt.NDArray[np.floating]
    """(v, 3) in the file's frame and unit."""
    faces: npt.NDArray[np.integer]
    """(n, 3) vertices of each triangle."""
    visual: _VertexColours


def read_triangle_file(path: Path) -> _TriangleMesh | None:
    """Mesh of a binary PLY or STL file; None for a file that the general reader has to read."""
    reader = {".ply": _read_ply, ".stl": _read_stl}.get(path.suffix.lower())
    if reader is None:
        return None
    with path.open("rb") as file:
        return reader(file, path.stat().st_size)


_STL_HEADER_BYTES = 84
_STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def _read_stl(file: BinaryIO, num_bytes: int) -> _TriangleMesh | None:
    count = int.from_bytes(file.read(_STL_HEADER_BYTES)[-4:], "little")
    # A text file whose 80th byte happens to fit its length is none.
    if not count or num_bytes != _STL_HEADER_BYTES + count * _STL_FACET.itemsize:
        return None
    corners = np.fromfile(file, _STL_FACET, count)["corners"]
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return _TriangleMesh(corners.reshape(-1, 3), faces, _VertexColours(None, None))


_PLY_TYPES = {
    **{"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1"},
    **{"short": "<i2", "int16": "<i2", "ushort": "<u2", "uint16": "<u2"},
    **{"int": "<i4", "int32": "<i4", "uint": "<u4", "uint32": "<u4"},
    **{"float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8"},
}
# Properties of a vertex that say nothing about colour or texture, beside its position.
_IGNORED = frozenset(("nx", "ny", "nz", "alpha", "quality", "confidence", "intensity"))
_COLOURS = ("red", "green", "blue")
_INDICES = ("vertex_indices", "vertex_index")
_MAX_HEADER_LINES = 64
_MAX_LINE_BYTES = 256


def _read_ply(file: BinaryIO, num_bytes: int) -> _TriangleMesh | None:
    header = _read_ply_header(file)
    if header is None:
        return None
    (num_vertices, vertex), (num_faces, face) = header
    if num_bytes != file.tell() + num_vertices * vertex.itemsize + num_faces * face.itemsize:
        return None
    vertices = np.fromfile(file, vertex, num_vertices)
    faces = np.fromfile(file, face, num_faces)
    if not num_faces or (faces["corners"] != 3).any():
        return None
    indices = np.ascontiguousarray(faces["indices"])
    # A negative index would be counted from the end.
    if indices.min() < 0 or indices.max() >= num_vertices:
        return None
    return _TriangleMesh(_columns(vertices, ("x", "y", "z")), indices, _ply_colours(vertices))


def _columns(records: npt.NDArray[np.void], names: tuple[str, ...]) -> npt.NDArray[np.floating]:
    """(n, k) fields of records."""
    return np.stack([records[name] for name in names], axis=-1)


def _ply_colours(vertices: npt.NDArray[np.void]) -> _VertexColours:
    assert vertices.dtype.names is not None, "a vertex has properties"
    if "red" not in vertices.dtype.names:
        return _VertexColours(None, None)
    return _VertexColours("vertex", _columns(vertices, _COLOURS).astype(np.uint8, copy=False))


_Element = tuple[int, np.dtype[np.void]]  # number of records, and their type


def _read_ply_header(file: BinaryIO) -> tuple[_Element, _Element] | None:
    """Vertices and faces of a header; None for one that says anything else."""
    read = (file.readline(_MAX_LINE_BYTES).split() for _ in range(_MAX_HEADER_LINES))
    lines = takewhile(lambda words: words != [b"end_header"], read)
    words = [[word.decode("latin-1") for word in line] for line in lines]
    words = [line for line in words if line[:1] != ["obj_info"]]
    words = [line for line in words if line[:1] != ["comment"] or "TextureFile" in line]
    if words[:2] != [["ply"], ["format", "binary_little_endian", "1.0"]]:
        return None
    starts = [number for number, line in enumerate(words) if line[:1] == ["element"]]
    if len(starts) != 2 or starts[0] != 2:
        return None
    vertex = _parse_vertex(words[starts[0] : starts[1]])
    face = _parse_face(words[starts[1] :])
    return None if vertex is None or face is None else (vertex, face)


def _parse_vertex(lines: list[list[str]]) -> _Element | None:
    """Element of lines `element vertex N`, `property float x` and so on."""
    count = _parse_count(lines[0], "vertex")
    if count is None or not all(
        len(line) == 3 and line[0] == "property" and line[1] in _PLY_TYPES for line in lines[1:]
    ):
        return None
    types = {name: _PLY_TYPES[kind] for _, kind, name in lines[1:]}
    colours = [types[name] for name in _COLOURS if name in types]
    known = {"x", "y", "z", *_COLOURS} | _IGNORED
    if len(types) < len(lines) - 1 or not {"x", "y", "z"} <= set(types) <= known:
        return None
    if colours not in ([], ["u1"] * 3) or any(types[name][1] != "f" for name in "xyz"):
        return None
    return count, np.dtype(list(types.items()))


def _parse_face(lines: list[list[str]]) -> _Element | None:
    """Element of the lines `element face N` and `property list uchar int vertex_indices`."""
    count = _parse_count(lines[0], "face")
    if count is None or len(lines) != 2 or len(lines[1]) != 5:
        return None
    keyword, form, length, kind, name = lines[1]
    if (keyword, form) != ("property", "list") or name not in _INDICES:
        return None
    if _PLY_TYPES.get(length) != "u1" or _PLY_TYPES.get(kind) not in ("<i4", "<u4"):
        return None
    return count, np.dtype([("corners", "u1"), ("indices", _PLY_TYPES[kind], 3)])


def _parse_count(line: list[str], name: str) -> int | None:
    """Number of records of a line such as `element face 12`."""
    is_count = len(line) == 3 and line[1] == name and line[2].isascii() and line[2].isdigit()
    return int(line[2]) if is_count else None
