"""Mesh files (GLB, glTF, OBJ, PLY, STL, DAE) as triangles in SAE, by the reader of each format.

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
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import ConfigError, DomainError, SourceLocation
from catoptra_protocol.optics.elementary import einsum, matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.runtime.memory import BYTES_PER_TRIANGLE, MemoryBudget
from catoptra_server.world.collada_file import read_collada
from catoptra_server.world.gltf import FileLight, read_gltf, read_lights
from catoptra_server.world.mesh_assets import (
    MID_GREY,
    WHITE,
    FileMaterial,
    FileMesh,
    Losses,
    MeshAssets,
)
from catoptra_server.world.scene_mesh import MeshPart
from catoptra_server.world.shapes import facet_normals
from catoptra_server.world.textures import (
    MeshAppearance,
    TextureReader,
    clip_fractions,
    corner_albedos,
    linear_light,
    no_texture_coordinates,
)
from catoptra_server.world.triangles import gather_rows, row_blocks, select_rows
from catoptra_server.world.wavefront import read_obj
from catoptra_server.world.world_description import (
    DirectionalLight,
    Light,
    MeshFile,
    PointLight,
)

log = logging.getLogger(__name__)
# Ten times the largest coordinate of a world's file. A float32 has steps of 6 cm there.
_MAX_COORDINATE_M = 1e6
# Readers of further formats (archives, CAD files) exist in trimesh; their memory has no bound.
_GLTF_SUFFIXES = (".glb", ".gltf")
_SUFFIXES = (*_GLTF_SUFFIXES, ".obj", ".ply", ".stl", ".dae")
# While a file is read: lines of an OBJ or elements of a DAE are objects of Python; of glTF's, JSON.
_READ_BYTES_PER_FILE_BYTE = 10
_GLTF_BYTES_PER_FILE_BYTE = 3
# Normals at corners: 72 bytes in float64, 36 in each renderer's float32.
_BYTES_PER_SMOOTH_TRIANGLE = 150
# With more repetitions float32 cannot resolve a position within the texture.
_MAX_TEXTURE_REPEATS = 1e6

# SAE from three conventions: z up (x forward, y left), y up (glTF and COLLADA: x right, z
# backwards) and COLLADA's x up (-y right, z backwards). Which coordinate of the file is x, y and z,
# and its sign.
_SAE_FROM_UP: dict[str, tuple[slice | list[int], tuple[float, float, float]]] = {
    "x": ([2, 1, 0], (-1.0, -1.0, -1.0)),
    "z": (slice(None), (1.0, -1.0, -1.0)),
    "y": ([2, 0, 1], (-1.0, 1.0, -1.0)),
}


class MeshFileLoader:
    """Loader of a scene's mesh files: a file is read once for all of its scales and axes."""

    def __init__(self, shapes: Iterable[MeshFile], textures: TextureReader) -> None:
        """Read nothing yet.

        Args:
            shapes: all files with their scales and axes, each loaded once.
            textures: reader of the scene's textures, which are there once it has waited for them.
        """
        self._textures = textures
        self._num_variants = Counter(map(_file_alone, set(shapes)))
        self._contents: dict[MeshFile, tuple[str, list[FileMesh]]] = {}

    def load(self, shape: MeshFile) -> list[MeshPart]:
        """Meshes of a file, scaled and rotated into SAE.

        Raises:
            ConfigError: The file is missing, unreadable, without a triangle, or larger than the
                budget.
        """
        _check_name(shape)
        try:
            meshes = list(self._load_meshes(shape))
        except ConfigError:
            raise
        except Exception as error:  # readers of six formats raise many types
            reason = f"{type(error).__name__}: {error}" if isinstance(error, KeyError) else error
            raise _mesh_file_error(shape, f"a readable mesh file ({reason})") from error
        if not meshes:
            raise _mesh_file_error(
                shape, "a mesh with triangles: this file has none, as one of points"
            )
        if not any(len(mesh.corners) for mesh in meshes):
            raise _mesh_file_error(
                shape,
                "a mesh with at least one triangle that has an area and corners within "
                f"{_MAX_COORDINATE_M:g} m at Scale={shape.scale:g}",
            )
        return meshes

    def _load_meshes(self, shape: MeshFile) -> Iterator[MeshPart]:
        """Yield the meshes of a file; sizes that the file announces are checked first."""
        file, losses = _file_alone(shape), Losses(shape.path)
        if file not in self._contents:
            self._reserve_reading(shape.path)
            up, meshes = _read_meshes(shape, self._textures, losses)
            if self._num_variants[file] > 1:
                meshes = self._contents.setdefault(file, (up, list(meshes)))[1]
        else:
            up, meshes = self._contents[file]
        self._num_variants[file] -= 1
        if self._num_variants[file] == 0:
            self._contents.pop(file, None)
        for mesh in meshes:
            count, is_smooth = len(mesh.faces), mesh.normals is not None
            memory = self._textures.memory
            reserve_triangles(count, memory, shape.path, mesh.name, is_smooth=is_smooth)
            if mesh.material.blends:  # its texels say whether it does
                self._textures.wait(mesh.material.texture)
            yield _convert_mesh(mesh, shape, shape.up or up)
        if self._textures.has_texels:  # else the file is read once more, for its looks
            losses.log()

    def _reserve_reading(self, path: Path) -> None:
        num_bytes = path.stat().st_size
        per_byte = _GLTF_BYTES_PER_FILE_BYTE if _is_gltf(path) else _READ_BYTES_PER_FILE_BYTE
        self._textures.memory.for_reading().reserve(
            per_byte * num_bytes,
            where=SourceLocation(str(path)),
            key="File",
            value=f"{num_bytes} bytes",
            remedy="a smaller mesh file",
        )


def _file_alone(shape: MeshFile) -> MeshFile:
    """The file, whatever its scale and axes."""
    return replace(shape, scale=1.0, up="")


def load_mesh_lights(shape: MeshFile) -> list[Light]:
    """Load the lights of a glTF file, scaled and rotated into SAE; none of a file that is none.

    `MeshFileLoader` reports what is wrong with a file.
    """
    if shape.path.suffix.lower() not in _GLTF_SUFFIXES:
        return []
    try:
        _check_name(shape)
        found = read_lights(shape.path)
        order, signs = _SAE_FROM_UP[shape.up or "y"]
        return [_convert_light(light, shape.scale, order, np.array(signs)) for light in found]
    except DomainError as error:
        log.warning("%s: it is drawn without its lights: %s", shape.path, error)
        return []
    except Exception:  # as above
        return []


def _convert_light(
    light: FileLight, scale: float, order: slice | list[int], signs: Floats
) -> Light:
    if light.kind == "directional":
        x, y, z = (light.direction[order] * signs).tolist()
        return DirectionalLight((x, y, z), light.colour)
    x, y, z = (light.position[order] * (scale * signs)).tolist()
    # A light of a file's unit is as bright at one unit; ours at one metre.
    r, g, b = (scale * scale * value for value in light.colour)
    return PointLight((x, y, z), (r, g, b))


def _check_name(shape: MeshFile) -> None:
    if not shape.path.is_file():
        raise _mesh_file_error(shape, "a mesh file that exists")
    if shape.path.suffix.lower() not in _SUFFIXES:
        raise _mesh_file_error(shape, f"a mesh file of a known format: {', '.join(_SUFFIXES)}")


def _is_gltf(path: Path) -> bool:
    return path.suffix.lower() in _GLTF_SUFFIXES


def _read_meshes(
    shape: MeshFile, textures: TextureReader, losses: Losses
) -> tuple[str, Iterable[FileMesh]]:
    """Upward axis and meshes of a file."""
    path = shape.path
    assets = MeshAssets(shape, textures, losses)
    match path.suffix.lower():
        case ".glb" | ".gltf":
            return "y", read_gltf(path, assets, losses)
        case ".obj":
            return "z", read_obj(path, assets, losses)
        case ".dae":
            return read_collada(path, assets, losses)
    mesh = read_triangle_file(path)
    return "z", _read_scene(path, assets) if mesh is None else [mesh]


def _read_scene(path: Path, assets: MeshAssets) -> Iterator[FileMesh]:
    """Yield the meshes of a PLY or STL file as trimesh reads it."""
    # Imported on demand: loading trimesh takes longer than most files.
    import trimesh

    names = _TextureNames()
    # process=False: no merging of vertices, which would change texture coordinates at seams.
    scene = trimesh.load_scene(path, resolver=names, process=False)
    texture = assets.get_texture(names.asked[0], path.name) if names.asked else None
    for name, mesh in scene.geometry.items():
        # A scene may hold point clouds and paths, which have no faces.
        if getattr(mesh, "faces", None) is None:
            continue
        visual = mesh.visual
        uv, kind = getattr(visual, "uv", None), getattr(visual, "kind", None)
        look = FileMaterial(
            WHITE if texture is not None or kind in ("vertex", "face") else MID_GREY
        )
        alphas = visual.vertex_colors[:, 3] if kind == "vertex" else None
        look, opacities = _add_alpha(replace(look, texture=texture), alphas)
        yield FileMesh(
            name,
            mesh.vertices,
            mesh.faces,
            look,
            # trimesh counts v from the bottom, images count rows from the top.
            None if uv is None else np.asarray(uv) * (1.0, -1.0) + (0.0, 1.0),
            linear_light(visual.vertex_colors) if kind == "vertex" else None,
            opacities,
            face_colours=linear_light(visual.face_colors) if kind == "face" else None,
        )


class _TextureNames:
    """Names of files that trimesh asks for; none is there for it."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def get(self, name: str) -> bytes:
        """Remember a name."""
        self.asked.append(name)
        raise FileNotFoundError(name)

    __getitem__ = get


def reserve_triangles(
    count: int, memory: MemoryBudget, path: Path, name: str, *, is_smooth: bool
) -> None:
    """Count the triangles of a file's mesh at one place.

    Raises:
        ConfigError: The budget is exceeded.
    """
    memory.reserve(
        count * (BYTES_PER_TRIANGLE + (_BYTES_PER_SMOOTH_TRIANGLE if is_smooth else 0)),
        where=SourceLocation(str(path)),
        key="File",
        value=f"mesh {name} of {count} triangles",
        remedy="fewer triangles",
    )


def _mesh_file_error(shape: MeshFile, expected: str) -> ConfigError:
    path = str(shape.path)
    return ConfigError(SourceLocation(path), key="File", value=path, expected=expected)


def _convert_mesh(mesh: FileMesh, shape: MeshFile, up: str) -> MeshPart:
    """Convert a mesh, without triangles that cannot be rendered.

    Triangles without area show nothing and are dropped silently; triangles without finite positions
    or texture coordinates are a defect of the file and logged.

    Args:
        mesh: the mesh.
        shape: the file with its scale.
        up: upward axis of the file.
    """
    faces = mesh.faces
    # A mirrored copy is wound the other way round: its triangles would face inwards.
    if np.linalg.det(mesh.file_from_mesh[:3, :3]) < 0.0:
        faces = faces[:, ::-1]
    appearance = _make_appearance(mesh, faces)
    corners = gather_rows(_sae_vertices(mesh, shape.scale, up), faces)
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
    if mesh.normals is not None:
        at_corners = gather_rows(_sae_normals(mesh, up), faces)
        appearance = replace(appearance, corner_normals=at_corners)
    corners, appearance = select_rows(corners, valid), appearance.select(valid)
    normals, has_area = facet_normals(corners)
    appearance = _flatten_normals(appearance, normals)
    return MeshPart(
        select_rows(corners, has_area),
        select_rows(normals, has_area),
        appearance.select(has_area),
        node=mesh.node,
    )


def _make_appearance(mesh: FileMesh, faces: npt.NDArray[np.integer]) -> MeshAppearance:
    """Appearance of (n, 3) triangles of a mesh."""
    material, base = mesh.material, np.array(mesh.material.albedo)
    texture = None if mesh.uv is None else material.texture
    uv = no_texture_coordinates(len(faces))
    if texture is not None and mesh.uv is not None:
        uv = np.asarray(mesh.uv, dtype=np.float64).take(faces, axis=0)
    albedo, corner_albedo = np.broadcast_to(base, (len(faces), 3)), None
    if mesh.face_colours is not None:
        albedo = base * mesh.face_colours
    elif mesh.colours is not None:
        albedo, corner_albedo = corner_albedos(base * mesh.colours, faces)
    coverage, blends = _find_coverage(mesh, faces), material.blends
    if blends and coverage is not None and (coverage >= 2.0).all():
        # Many files say of all materials that they blend.
        blends = texture is not None and bool((texture[..., 3:] < 255).any())
    return MeshAppearance(
        uv,
        albedo,
        corner_albedo,
        texture,
        material.unlit,
        material.sampling,
        material.emission,
        two_sided=material.two_sided,
        single_sided=material.single_sided,
        coverage=None if material.blends and not blends else coverage,
        blends=blends,
    )


def _find_coverage(mesh: FileMesh, faces: npt.NDArray[np.integer]) -> Floats | None:
    """(n, 3) opacity at corners over the cutoff; None for a mesh without holes."""
    cutoff, opacity = mesh.material.cutoff, mesh.material.opacity
    if cutoff <= 0.0:
        return None
    if mesh.opacities is None:
        return np.full((len(faces), 3), opacity / cutoff)
    return mesh.opacities.take(faces) * (opacity / cutoff)


def _sae_vertices(mesh: FileMesh, scale: float, up: str) -> Floats:
    """(v, 3) vertices of a mesh, metres, SAE; infinite or no numbers where the file's are."""
    vertices, file_from_mesh = np.asarray(mesh.vertices), mesh.file_from_mesh
    with np.errstate(invalid="ignore", over="ignore"):
        if not np.array_equal(file_from_mesh, np.eye(4)):
            vertices = (
                matmul(vertices.astype(np.float64), file_from_mesh[:3, :3].T)
                + file_from_mesh[:3, 3]
            )
        order, signs = _SAE_FROM_UP[up]
        sae: Floats = vertices[:, order] * (scale * np.array(signs))
        return sae


def _sae_normals(mesh: FileMesh, up: str) -> Floats:
    """(v, 3) unit normals at a mesh's vertices, SAE; zero where the file has no direction."""
    order, signs = _SAE_FROM_UP[up]
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        # Normals of a surface take the inverse transposed.
        inverse = np.linalg.pinv(mesh.file_from_mesh[:3, :3])
        turned = matmul(np.asarray(mesh.normals, dtype=np.float64), inverse)[:, order]
        length = np.sqrt(np.square(turned).sum(axis=-1, keepdims=True))
        unit: Floats = turned * (np.array(signs) / length)
    return np.nan_to_num(unit, posinf=0.0, neginf=0.0)


# A quarter of a degree: 0.3 % of the light of a surface at 45 degrees, less than a grey level.
_MIN_FLAT_COSINE = 1.0 - 1e-5


def _flatten_normals(look: MeshAppearance, normals: Floats) -> MeshAppearance:
    """Appearance with the normals of (n, 3) facets where those at all corners are the same."""
    at_corners = look.corner_normals
    if at_corners is None:
        return look
    # Directions that are none are the facet's.
    has_none: Bools = np.asarray(~at_corners.any(axis=-1))
    cosines = einsum("nki,ni->nk", at_corners, normals)
    is_flat: Bools = np.asarray(((cosines >= _MIN_FLAT_COSINE) | has_none).all(axis=-1))
    if is_flat.all():
        return replace(look, corner_normals=None)
    flat = (has_none | is_flat[:, None])[..., None]
    return replace(look, corner_normals=np.where(flat, normals[:, None], at_corners))


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


def read_triangle_file(path: Path) -> FileMesh | None:
    """Mesh of a binary PLY or STL file; None for a file that the general reader has to read."""
    reader = {".ply": _read_ply, ".stl": _read_stl}.get(path.suffix.lower())
    if reader is None:
        return None
    with path.open("rb") as file:
        return reader(file, path.stat().st_size)


_STL_HEADER_BYTES = 84
_STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_FACET_BIT, _CHANNEL_MAX = 1 << 15, 31


def _read_stl(file: BinaryIO, num_bytes: int) -> FileMesh | None:
    header = file.read(_STL_HEADER_BYTES)
    count = int.from_bytes(header[-4:], "little")
    # A text file whose 80th byte happens to fit its length is none.
    if not count or num_bytes != _STL_HEADER_BYTES + count * _STL_FACET.itemsize:
        return None
    facets = np.fromfile(file, _STL_FACET, count)
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    colours = _stl_colours(header, facets["attribute"])
    material = FileMaterial(MID_GREY if colours is None else WHITE)
    vertices = facets["corners"].reshape(-1, 3)
    return FileMesh("stl", vertices, faces, material, face_colours=colours)


def _stl_colours(header: bytes, attributes: npt.NDArray[np.uint16]) -> Floats | None:
    """(n, 3) linear colours of facets; None for a file without.

    Five bits a channel. Materialise Magics writes the whole's colour behind `COLOR=`, and red
    lowest in facets whose highest bit is not set; VisCAM has red highest where that bit is set.
    """
    is_set = (attributes & _FACET_BIT) != 0
    shifts = np.array((10, 5, 0))
    start = header.find(b"COLOR=")
    if start >= 0 and start + 9 <= _STL_HEADER_BYTES - 4:
        whole = linear_light(np.frombuffer(header, np.uint8, 3, start + 6))
        has_own, shifts = ~is_set, shifts[::-1]
    elif is_set.any():
        whole, has_own = np.array(MID_GREY), is_set
    else:
        return None
    channels = (attributes[:, None] >> shifts) & _CHANNEL_MAX
    return np.where(has_own[:, None], linear_light(channels / _CHANNEL_MAX), whole)


_PLY_TYPES = {
    **{"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1"},
    **{"short": "<i2", "int16": "<i2", "ushort": "<u2", "uint16": "<u2"},
    **{"int": "<i4", "int32": "<i4", "uint": "<u4", "uint32": "<u4"},
    **{"float": "<f4", "float32": "<f4", "double": "<f8", "float64": "<f8"},
}
# Properties of a vertex that say nothing about colour or texture, beside its position.
_IGNORED = frozenset(("nx", "ny", "nz", "quality", "confidence", "intensity"))
_COLOURS = ("red", "green", "blue")
_INDICES = ("vertex_indices", "vertex_index")
_MAX_HEADER_LINES = 64
_MAX_LINE_BYTES = 256


def _read_ply(file: BinaryIO, num_bytes: int) -> FileMesh | None:
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
    colours = _ply_colours(vertices)
    alphas = vertices["alpha"] if "alpha" in (vertices.dtype.names or ()) else None
    material, opacities = _add_alpha(FileMaterial(MID_GREY if colours is None else WHITE), alphas)
    places = _columns(vertices, ("x", "y", "z"))
    return FileMesh("ply", places, indices, material, colours=colours, opacities=opacities)


def _add_alpha(
    material: FileMaterial, alphas: npt.NDArray[Any] | None
) -> tuple[FileMaterial, Floats | None]:
    """Material of a PLY file, and (v,) opacities of bytes or fractions at vertices."""
    # Zeros alone are a property that a program left unset.
    if alphas is None or not alphas.any():
        return material, None
    limit = np.iinfo(alphas.dtype).max if alphas.dtype.kind in "iu" else 1.0
    blended = replace(material, two_sided=True, cutoff=0.5, blends=True)
    return blended, clip_fractions(alphas / limit)


def _columns(records: npt.NDArray[np.void], names: tuple[str, ...]) -> npt.NDArray[np.floating]:
    """(n, k) fields of records."""
    return np.stack([records[name] for name in names], axis=-1)


def _ply_colours(vertices: npt.NDArray[np.void]) -> Floats | None:
    """(v, 3) linear colours at vertices."""
    names = vertices.dtype.names or ()
    return linear_light(_columns(vertices, _COLOURS)) if "red" in names else None


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
    known = {"x", "y", "z", "alpha", *_COLOURS} | _IGNORED
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
