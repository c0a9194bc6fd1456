"""Binary PLY and STL files of nothing but triangles, read without trimesh.

The two formats of scanned and generated meshes, which are often large, and whose arrays lie in the
file as they are needed. Loading trimesh alone takes 0.1 to 0.15 s, half the time of a million
triangles. Whatever these readers do not know, damaged files too, is left to trimesh.

Sources: G. Turk, "The PLY Polygon File Format", 1994; 3D Systems, "StereoLithography Interface
Specification", 1989.
"""

from __future__ import annotations

from itertools import takewhile
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from catoptra_protocol.slotted_dataclass import dataclass

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

_STL_HEADER_BYTES = 84
_STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@dataclass(frozen=True, slots=True, eq=False)
class VertexColours:
    """Appearance in the form that trimesh gives it: colours at vertices, or none."""

    kind: str | None
    """`vertex`, or None without colours."""
    vertex_colors: npt.NDArray[np.uint8] | None
    """(v, 3) sRGB."""


@dataclass(frozen=True, slots=True, eq=False)
class TriangleMesh:
    """Mesh in the form that trimesh gives it."""

    vertices: npt.NDArray[np.floating]
    """(v, 3) in the file's frame and unit."""
    faces: npt.NDArray[np.integer]
    """(n, 3) vertices of each triangle."""
    visual: VertexColours


def read_triangle_file(path: Path) -> TriangleMesh | None:
    """Mesh of a binary PLY or STL file; None for a file that the general reader has to read."""
    reader = {".ply": _read_ply, ".stl": _read_stl}.get(path.suffix.lower())
    if reader is None:
        return None
    with path.open("rb") as file:
        return reader(file, path.stat().st_size)


def _read_stl(file: BinaryIO, num_bytes: int) -> TriangleMesh | None:
    count = int.from_bytes(file.read(_STL_HEADER_BYTES)[-4:], "little")
    # A text file whose 80th byte happens to fit its length is none.
    if not count or num_bytes != _STL_HEADER_BYTES + count * _STL_FACET.itemsize:
        return None
    corners = np.fromfile(file, _STL_FACET, count)["corners"]
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return TriangleMesh(corners.reshape(-1, 3), faces, VertexColours(None, None))


def _read_ply(file: BinaryIO, num_bytes: int) -> TriangleMesh | None:
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
    return TriangleMesh(_columns(vertices, ("x", "y", "z")), indices, _ply_colours(vertices))


def _columns(records: npt.NDArray[np.void], names: tuple[str, ...]) -> npt.NDArray[np.floating]:
    """(n, k) fields of records."""
    return np.stack([records[name] for name in names], axis=-1)


def _ply_colours(vertices: npt.NDArray[np.void]) -> VertexColours:
    assert vertices.dtype.names is not None, "a vertex has properties"
    if "red" not in vertices.dtype.names:
        return VertexColours(None, None)
    return VertexColours("vertex", _columns(vertices, _COLOURS).astype(np.uint8, copy=False))


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
