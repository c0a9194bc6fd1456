"""Reader of Wavefront OBJ: triangles by trimesh, materials of MTL files by this module.

trimesh drops what an MTL file says of emission, opacity and texture coordinates, and takes one
colour for its own placeholder. Colours are sRGB, as modelling programs write them. Text is UTF-8 or
else Latin-1.

Source: Wavefront, Advanced Visualizer, appendix B1 (OBJ) and B2 (MTL), 1995.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.mesh_assets import (
    MID_GREY,
    WHITE,
    FileMaterial,
    FileMesh,
    Losses,
    MeshAssets,
)
from catoptra_server.world.textures import REPEATED, TextureSampling, add_opacity, linear_light
from catoptra_server.world.world_description import Rgb

_LIBRARY = re.compile(r"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", re.MULTILINE)
_LIBRARY_END = re.compile(r"(?<=\.mtl)\s+", re.IGNORECASE)
_MAX_MATERIALS = 10_000
# Options of a texture: how many words follow at most, numbers all of them but for the last three.
_OPTION_WORDS = {
    **{"-s": 3, "-o": 3, "-t": 3, "-mm": 2, "-boost": 1, "-texres": 1, "-bm": 1},
    **{"-blendu": 1, "-blendv": 1, "-clamp": 1, "-cc": 1, "-imfchan": 1, "-type": 1},
}
_WORD_OPTIONS = frozenset(("-blendu", "-blendv", "-clamp", "-cc", "-imfchan", "-type"))


@dataclass(frozen=True, slots=True, eq=False)
class _Paint:
    """A material with the place of its texture."""

    material: FileMaterial
    scale: tuple[float, float] = (1.0, 1.0)
    offset: tuple[float, float] = (0.0, 0.0)


def read_obj(path: Path, assets: MeshAssets, losses: Losses) -> Iterator[FileMesh]:
    """Yield the meshes of a file, one for each material.

    Args:
        path: the file.
        assets: files beside it.
        losses: what is not drawn.

    Raises:
        ConfigError: A library or a texture is missing, no image, or exceeds the budget.
        ValueError, IndexError: The file is no OBJ.
    """
    # Imported on demand: loading trimesh takes longer than most files.
    from trimesh.exchange.obj import load_obj

    text = _decode(path.read_bytes())
    paints: dict[str, _Paint] = {}
    for library in _LIBRARY.findall(text):
        for data in _read_libraries(library, assets):
            for name, lines in _split_materials(_decode(data)).items():
                paints.setdefault(name, _make_paint(name, lines, assets, losses))
    names = "".join(f"newmtl {name}\nKd 1 1 1\n" for name in paints)
    # trimesh reads the first library alone: here it has the names of all.
    text = "mtllib all\n" + _LIBRARY.sub("", text)
    loaded = load_obj(io.StringIO(text), resolver={"all": names.encode()})
    for name, mesh in loaded.get("geometry", {}).items():
        visual, colours = mesh.get("visual"), mesh.get("vertex_colors")
        paint = paints.get(visual.material.name) if visual is not None else None
        if paint is None:
            albedo = MID_GREY if colours is None else WHITE
            paint = _Paint(FileMaterial(albedo))
        yield FileMesh(
            name,
            mesh["vertices"],
            _split_polygons(mesh["faces"]),
            paint.material,
            None if visual is None or visual.uv is None else _place(visual.uv, paint),
            None if colours is None else linear_light(colours),
            normals=mesh.get("vertex_normals"),
        )


def _decode(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _split_polygons(faces: npt.NDArray[np.integer]) -> npt.NDArray[np.integer]:
    """(n (k - 2), 3) vertices of the triangles of (n, k) polygons, as fans."""
    corner = np.arange(1, faces.shape[1] - 1)
    fan = np.stack((0 * corner, corner, corner + 1), axis=-1)
    return faces[:, fan].reshape(-1, 3)


def _place(uv: Floats, paint: _Paint) -> Floats:
    """(v, 2) coordinates from the top left of coordinates from the bottom left."""
    placed = np.asarray(uv, dtype=np.float64)[:, :2] * paint.scale + paint.offset
    return placed * (1.0, -1.0) + (0.0, 1.0)


def _read_libraries(names: str, assets: MeshAssets) -> Iterator[bytes]:
    """Yield the content of libraries, whose names may have spaces."""
    try:
        yield assets.get(names)
        return
    except FileNotFoundError as error:
        if len(parts := _LIBRARY_END.split(names)) == 1:
            assets.report_missing(names, "materials", error)
            return
    for part in parts:
        yield from _read_libraries(part, assets)


def _split_materials(text: str) -> dict[str, list[list[str]]]:
    """Lines of each material, as words; keywords in small letters."""
    materials: dict[str, list[list[str]]] = {}
    lines: list[list[str]] = []
    for line in text.replace("\\\n", " ").splitlines():
        words = line.split("#")[0].split()
        if len(words) < 2:
            continue
        if words[0].lower() == "newmtl":
            lines = materials.setdefault(" ".join(words[1:]), [])
            if len(materials) > _MAX_MATERIALS:
                raise ValueError(f"a library has more than {_MAX_MATERIALS} materials")
        else:
            lines.append([words[0].lower(), *words[1:]])
    return materials


def _make_paint(name: str, lines: list[list[str]], assets: MeshAssets, losses: Losses) -> _Paint:
    """Material of the lines of an MTL file."""
    given = {words[0]: words[1:] for words in lines}
    texture, sampling, scale, offset = None, REPEATED, (1.0, 1.0), (0.0, 0.0)
    if "map_kd" in given:
        file, options = _parse_map(given["map_kd"])
        texture = assets.get_texture(file, f"material {name}")
        scale, offset = _pair(options.get("-s"), 1.0), _pair(options.get("-o"), 0.0)
        clamps = options.get("-clamp") == ["on"]
        sampling = TextureSampling(clamps, clamps)
    albedo = MID_GREY if texture is None else WHITE
    if "kd" in given:
        albedo = _read_colour(given["kd"])
    emission = _read_colour(given["ke"]) if "ke" in given else (0.0, 0.0, 0.0)
    opacity = float(given["d"][-1]) if "d" in given else 1.0 - float(given.get("tr", ["0"])[-1])
    if "map_d" in given:
        file, options = _parse_map(given["map_d"])
        holes = assets.get_texture(file, f"material {name}")
        if texture is None:
            scale, offset = _pair(options.get("-s"), 1.0), _pair(options.get("-o"), 0.0)
        assets.textures.wait(texture)
        assets.textures.wait(holes)
        texture = add_opacity(texture, holes[..., 0])
    blends = opacity < 1.0 or "map_d" in given
    for key in given:
        if key in ("bump", "map_bump", "norm", "disp"):
            losses.add("bump map", "surfaces are shaded without its bumps")
        if key == "map_ke":
            losses.add("texture of emission map_Ke", "drawn without")
    return _Paint(
        FileMaterial(
            albedo,
            texture,
            sampling=sampling,
            emission=emission,
            two_sided=blends,
            opacity=opacity,
            cutoff=0.5 if blends else 0.0,
            blends=blends,
        ),
        scale,
        offset,
    )


def _read_colour(words: list[str]) -> Rgb:
    """Linear colour of one number, or of three; spectral files and CIE colours are not read."""
    values = [float(word) for word in words[:3]]
    r, g, b = linear_light(np.array(values if len(values) == 3 else values[:1] * 3)).tolist()
    return r, g, b


def _parse_map(words: list[str]) -> tuple[str, dict[str, list[str]]]:
    """File name of a texture, which may have spaces, and its options."""
    options: dict[str, list[str]] = {}
    rest = list(words)
    while len(rest) > 1 and rest[0].lower() in _OPTION_WORDS:
        option = rest.pop(0).lower()
        options[option] = []
        for _ in range(_OPTION_WORDS[option]):
            # Fewer numbers than there may be, and always a file name after them.
            if len(rest) == 1 or not (option in _WORD_OPTIONS or _is_number(rest[0])):
                break
            options[option].append(rest.pop(0))
    return " ".join(rest), options


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _pair(words: list[str] | None, default: float) -> tuple[float, float]:
    """The first two numbers of up to three."""
    first, second, *_ = [*map(float, words or ()), default, default]
    return first, second
