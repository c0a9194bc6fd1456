"""Reader of glTF and GLB: meshes and lights of the default scene, from the file's own JSON.

Sizes are counted before memory is taken: a few bytes of JSON can name arrays of gigabytes, since an
accessor without a buffer view is zeros of any length, buffer views may overlap, and an image may be
of any size.

Approximations of the shading model, which is matt:

* Metals have their base colour, whatever the roughness: in even light of radiance 1 a metal
  reflects its base colour, and a matt surface of that albedo does the same.
* Specular and glossiness likewise: diffuse (1 - max(specular)) + specular, the light that both
  parts reflect in even light.
* A texture of occlusion multiplies the base colour, so it darkens direct light, too.
* A texture of emission is exact on a black surface, which is then shown at that texture, whatever
  the lights; other surfaces shine in its mean colour.

A light's unit is that of luminance: 1 is white, so a surface of albedo a under E lux has a E / pi.
Skins, morph targets and animations are named and not drawn: a mesh is shown as it is stored.

Sources: glTF 2.0, Khronos 2021; KHR_texture_transform, KHR_mesh_quantization, KHR_lights_punctual,
KHR_materials_unlit, KHR_materials_emissive_strength, KHR_materials_pbrSpecularGlossiness,
EXT_mesh_gpu_instancing, EXT_texture_webp.
"""

from __future__ import annotations

import base64
import binascii
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import SourceLocation
from catoptra_protocol.optics.elementary import cos, matmul, sin
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.runtime.memory import MemoryBudget
from catoptra_server.world.mesh_assets import WHITE, FileMaterial, FileMesh, Losses, MeshAssets
from catoptra_server.world.textures import (
    Texture,
    TextureSampling,
    clip_fractions,
    linear_light,
    multiply_texture,
)
from catoptra_server.world.world_description import Rgb

_MAGIC = b"glTF"
_DTYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_CLAMP, _MIRROR, _NEAREST = 33071, 33648, 9728
# Each is an object of Python with its arrays; the file itself may name as many as it has bytes.
_MAX_MATERIALS, _MAX_NODES = 10_000, 200_000
_WHITE_TEXTURE: Texture = np.full((1, 1, 3), 255, dtype=np.uint8)
# A thousand times white is a lamp that blinds; the squares of sums are float32 numbers.
_MAX_EMISSION = 1e3

_DRAWN = frozenset(
    (
        "KHR_materials_unlit",
        "KHR_materials_emissive_strength",
        "KHR_materials_pbrSpecularGlossiness",
        "KHR_texture_transform",
        "KHR_mesh_quantization",
        "KHR_lights_punctual",
        "EXT_mesh_gpu_instancing",
        "EXT_texture_webp",
    )
)
# Of other variants, or of nothing that a matt surface shows.
_WITHOUT_EFFECT = frozenset(
    ("KHR_materials_ior", "KHR_materials_variants", "KHR_xmp_json_ld", "KHR_xmp")
)


@dataclass(frozen=True, slots=True, eq=False)
class FileLight:
    """Light of a file, in the file's frame."""

    kind: str
    """`directional` or `point`."""
    colour: Rgb
    """Irradiance of a directional light; irradiance at one unit of the file of a point light."""
    position: Floats
    """(3,)."""
    direction: Floats
    """(3,) unit direction in which the light travels."""


def read_gltf(path: Path, assets: MeshAssets, losses: Losses) -> Iterator[FileMesh]:
    """Yield the meshes of a file's scene, each at each of its places.

    Args:
        path: the file.
        assets: files beside it.
        losses: what is not drawn.

    Raises:
        ConfigError: The budget is exceeded, or a texture is missing or no image.
        ValueError, KeyError, TypeError, IndexError, AttributeError: The file is no glTF.
    """
    document, chunk = _read_document(path)
    _parse_json.cache_clear()
    _check_extensions(document, losses)
    data = _Arrays(document, chunk, assets)
    data.reserve(assets.textures.memory.for_reading(), SourceLocation(str(path)))
    reader = _MeshReader(document, data, _Materials(document, data, assets, path, losses))
    if document.get("animations"):
        losses.add("animations", "the scene is drawn as it is stored")
    for node, name, matrix in _walk_nodes(document):
        if "mesh" in node:
            if "skin" in node:
                losses.add("skin", "its mesh is drawn as it is stored, not as its joints pose it")
            for placed in _instances(node, matrix, data):
                yield from reader.read(node["mesh"], name, placed)


def read_lights(path: Path) -> list[FileLight]:
    """Lights of a file's scene by KHR_lights_punctual; spot lights shine to all sides."""
    text, _ = _read_text(path)
    if b"KHR_lights_punctual" not in text:
        return []  # as most files: their JSON is parsed for their meshes, once
    document = _parse_json(text)
    kinds = document.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", [])
    lights = []
    for node, _, matrix in _walk_nodes(document) if kinds else ():
        index = node.get("extensions", {}).get("KHR_lights_punctual", {}).get("light")
        if index is None:
            continue
        light = kinds[index]
        # Of a white surface the luminance is E / pi.
        scale = float(light.get("intensity", 1.0)) / math.pi
        r, g, b = (scale * float(value) for value in light.get("color", WHITE))
        direction = -matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
        kind = "directional" if light["type"] == "directional" else "point"
        lights.append(FileLight(kind, (r, g, b), matrix[:3, 3], direction))
    return lights


def _read_document(path: Path) -> tuple[dict[str, Any], memoryview]:
    """JSON of a file, and the binary chunk of GLB."""
    text, end = _read_text(path)
    with path.open("rb") as file:
        file.seek(end)
        length = int.from_bytes(file.read(8)[:4], "little") if end else 0
        return _parse_json(text), memoryview(file.read(length))


def _read_text(path: Path) -> tuple[bytes, int]:
    """JSON of a file, and where it ends in GLB; else 0."""
    with path.open("rb") as file:
        head = file.read(20)
        if not head:
            raise ValueError("it is empty")
        if head[:4] != _MAGIC:
            return head + file.read(), 0
        stated, size = int.from_bytes(head[8:12], "little"), path.stat().st_size
        if size < stated:
            raise ValueError(f"it is cut off: {size} of {stated} bytes")
        return file.read(int.from_bytes(head[12:16], "little")), file.tell()


# The lights of a file are read before its meshes, and its JSON is parsed for both.
@lru_cache(maxsize=1)
def _parse_json(data: bytes) -> dict[str, Any]:
    try:
        document = json.loads(data)
    except RecursionError as error:
        raise ValueError("its JSON is nested too deeply") from error
    version = document["asset"]["version"]
    if not str(version).startswith("2."):
        raise ValueError(f"it is glTF {version}, and 2.0 is read")
    if len(document.get("materials", ())) > _MAX_MATERIALS:
        count = len(document["materials"])
        raise ValueError(f"it has {count} materials, and at most {_MAX_MATERIALS} are read")
    return dict(document)


def _check_extensions(document: dict[str, Any], losses: Losses) -> None:
    required = document.get("extensionsRequired", ())
    unknown = [name for name in required if name not in _DRAWN | _WITHOUT_EFFECT]
    if unknown:
        raise ValueError(f"it requires {', '.join(map(str, unknown))}, which is not read")
    for name in document.get("extensionsUsed", ()):
        if name not in _DRAWN | _WITHOUT_EFFECT:
            losses.add(str(name), "drawn without this extension")
    for light in document.get("extensions", {}).get("KHR_lights_punctual", {}).get("lights", ()):
        if light.get("type") == "spot":
            losses.add("spot light", "it shines to all sides")


def _walk_nodes(document: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str, Floats]]:
    """Yield the nodes of the default scene: JSON, name of its own, (4, 4) position in the file."""
    nodes = document.get("nodes", [])
    if len(nodes) > _MAX_NODES:
        raise ValueError(f"it has {len(nodes)} nodes, and at most {_MAX_NODES} are read")
    scenes = document.get("scenes")
    if scenes:
        roots = scenes[_index(document.get("scene", 0))].get("nodes", [])
    else:  # a library without scenes: all that is nobody's child
        children = {child for node in nodes for child in node.get("children", ())}
        roots = [index for index in range(len(nodes)) if index not in children]
    waiting = [(_index(root), np.eye(4)) for root in reversed(roots)]
    seen: set[int] = set()
    names: set[str] = set()
    while waiting:
        index, parent = waiting.pop()
        if index in seen:
            raise ValueError(f"node {index} has two parents, or is its own ancestor")
        seen.add(index)
        node = nodes[index]
        with np.errstate(invalid="ignore", over="ignore"):
            matrix = matmul(parent, _node_matrix(node))
        if not np.isfinite(matrix).all():
            raise ValueError(f"the position of node {index} is no number")
        name = str(node.get("name") or "")
        if not name and "mesh" in node:
            name = str(document["meshes"][_index(node["mesh"])].get("name") or f"node{index}")
        # Objects of one name would be one object.
        name = f"{name}.{index}" if name in names else name
        names.add(name)
        yield node, name, matrix
        waiting += [(_index(child), matrix) for child in reversed(node.get("children", ()))]


def _node_matrix(node: dict[str, Any]) -> Floats:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    translation = np.array(node.get("translation", (0, 0, 0)), dtype=np.float64)
    rotation = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
    scale = np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    matrix: Floats = _compose(translation[None], rotation[None], scale[None])[0]
    return matrix


def _compose(translation: Floats, rotation: Floats, scale: Floats) -> Floats:
    """(n, 4, 4) transforms of (n, 3) translations, (n, 4) quaternions x, y, z, w, (n, 3) scales."""
    x, y, z, w = np.moveaxis(rotation, -1, 0)
    rows = np.stack(
        (
            *(1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
            *(2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
            *(2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
        ),
        axis=-1,
    )
    matrices = np.tile(np.eye(4), (len(rows), 1, 1))
    matrices[:, :3, :3] = rows.reshape(-1, 3, 3) * scale[:, None]
    matrices[:, :3, 3] = translation
    return matrices


def _instances(node: dict[str, Any], matrix: Floats, data: _Arrays) -> Iterator[Floats]:
    """Yield the (4, 4) positions of a node's mesh: its own, or those of its instances."""
    extension = node.get("extensions", {}).get("EXT_mesh_gpu_instancing")
    if extension is None:
        yield matrix
        return
    given = {name: data.read(index) for name, index in extension["attributes"].items()}
    count = len(next(iter(given.values())))
    parts = [
        given.get(name, np.tile(default, (count, 1)))
        for name, default in (
            ("TRANSLATION", [0.0] * 3),
            ("ROTATION", [0, 0, 0, 1.0]),
            ("SCALE", [1.0] * 3),
        )
    ]
    with np.errstate(invalid="ignore", over="ignore"):
        placed = matmul(matrix, _compose(*parts))
    if not np.isfinite(placed).all():
        raise ValueError("the position of an instance is no number")
    yield from placed


def _index(value: object) -> int:
    # A negative index would count from the end, and True is 1.
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"an index is a whole number of at least 0, not {value!r:.40}")
    return value


class _Arrays:
    """Accessors and buffers of a document."""

    def __init__(self, document: dict[str, Any], chunk: memoryview, assets: MeshAssets) -> None:
        self._accessors = document.get("accessors", [])
        self._views = document.get("bufferViews", [])
        self._buffers = document.get("buffers", [])
        self._chunk = chunk
        self._assets = assets
        self._read: dict[int, memoryview] = {}

    def reserve(self, memory: MemoryBudget, where: SourceLocation) -> None:
        """Count all arrays that the file announces, in eight bytes a number."""
        numbers = sum(_index(one["count"]) * _COMPONENTS[one["type"]] for one in self._accessors)
        views = sum(_index(view["byteLength"]) for view in self._views)
        memory.reserve(
            8 * numbers + views,
            where=where,
            key="File",
            value=f"{len(self._accessors)} accessors",
            remedy="a mesh file with fewer or smaller accessors and buffer views",
        )

    def read(self, index: object) -> npt.NDArray[Any]:
        """(n, k) numbers of an accessor, or (n,) scalars; fractions where it is normalized."""
        accessor = self._accessors[_index(index)]
        count, width = _index(accessor["count"]), _COMPONENTS[accessor["type"]]
        dtype = np.dtype(_DTYPES[accessor["componentType"]])
        if "bufferView" in accessor:
            offset = _index(accessor.get("byteOffset", 0))
            values = self._rows(accessor["bufferView"], offset, count, width, dtype)
        else:
            values = np.zeros((count, width), dtype=dtype)
        if "sparse" in accessor:
            values = self._replace(values, accessor["sparse"])
        if accessor.get("normalized"):
            values = np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values[:, 0] if accessor["type"] == "SCALAR" else values

    def count(self, index: object) -> int:
        """Number of elements that an accessor announces."""
        return _index(self._accessors[_index(index)]["count"])

    def _replace(self, values: npt.NDArray[Any], sparse: dict[str, Any]) -> npt.NDArray[Any]:
        """Values with some rows replaced."""
        count, indices, given = _index(sparse["count"]), sparse["indices"], sparse["values"]
        kind = np.dtype(_DTYPES[indices["componentType"]])
        start = _index(indices.get("byteOffset", 0))
        rows = self._rows(indices["bufferView"], start, count, 1, kind)[:, 0]
        if count and int(rows.max()) >= len(values):
            raise ValueError(f"a sparse accessor of {len(values)} elements has no {rows.max()}")
        start = _index(given.get("byteOffset", 0))
        replaced = values.copy()
        replaced[rows] = self._rows(
            given["bufferView"], start, count, values.shape[1], values.dtype
        )
        return replaced

    def _rows(
        self, view: object, offset: int, count: int, width: int, dtype: np.dtype[Any]
    ) -> npt.NDArray[Any]:
        """(count, width) numbers in a buffer view, which may have bytes between rows."""
        entry = self._views[_index(view)]
        data, size = self.view_bytes(view), width * dtype.itemsize
        stride = _index(entry.get("byteStride", size)) or size
        if count and (stride < size or offset + stride * (count - 1) + size > len(data)):
            raise ValueError(f"buffer view {view} has {len(data)} bytes, too few for an accessor")
        strides = (stride, dtype.itemsize)
        return np.ndarray((count, width), dtype, buffer=data, offset=offset, strides=strides)

    def view_bytes(self, view: object) -> memoryview:
        """Content of a buffer view."""
        entry = self._views[_index(view)]
        buffer = self._buffer(_index(entry["buffer"]))
        start, length = _index(entry.get("byteOffset", 0)), _index(entry["byteLength"])
        if start + length > len(buffer):
            raise ValueError(f"buffer view {view} ends behind its buffer of {len(buffer)} bytes")
        return buffer[start : start + length]

    def _buffer(self, index: int) -> memoryview:
        if index not in self._read:
            uri = self._buffers[index].get("uri")
            self._read[index] = self._chunk if uri is None else memoryview(self.read_uri(uri))
        return self._read[index]

    def read_uri(self, uri: str) -> bytes:
        """Content of a file beside this one, or of a data URI."""
        if not uri.startswith("data:"):
            try:
                return self._assets.get(uri)
            except FileNotFoundError as error:
                raise ValueError(f"its buffer {uri} is not {error}") from error
        try:
            return base64.b64decode(uri.partition(",")[2])
        except binascii.Error as error:
            raise ValueError(f"a data URI is damaged: {error}") from error


@dataclass(frozen=True, slots=True, eq=False)
class _TextureUse:
    """A texture, and the texture coordinates at which a material shows it."""

    image: Texture
    coordinates: str
    """Attribute of texture coordinates."""
    uv_from_attribute: Floats
    """(2, 3)."""
    sampling: TextureSampling


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """A material, and where its texture's coordinates are."""

    material: FileMaterial
    use: _TextureUse | None


class _Materials:
    """Materials of a document, each made once."""

    def __init__(
        self,
        document: dict[str, Any],
        data: _Arrays,
        assets: MeshAssets,
        path: Path,
        losses: Losses,
    ) -> None:
        self._document = document
        self._data = data
        self._assets = assets
        self._path = path
        self.losses = losses
        self._looks: dict[int, _Look] = {}
        self._images: dict[tuple[int, bool], Texture] = {}
        self._mirrored: dict[tuple[int, bool, bool, bool], Texture] = {}
        self._occluded: dict[tuple[int, int, float], Texture] = {}

    @cached_property
    def default(self) -> _Look:
        """Material of what has none: white."""
        return _Look(FileMaterial(albedo=WHITE), None)

    def get(self, index: object) -> _Look:
        """Material of an index."""
        number = _index(index)
        if number not in self._looks:
            self._looks[number] = self._make(number)
        return self._looks[number]

    def _make(self, number: int) -> _Look:
        entry = self._document["materials"][number]
        user = f"material {entry.get('name', number)}"
        extensions = entry.get("extensions", {})
        metal = entry.get("pbrMetallicRoughness", {})
        factor, info = metal.get("baseColorFactor", WHITE), metal.get("baseColorTexture")
        albedo = _fractions(factor[:3])
        glossy = extensions.get("KHR_materials_pbrSpecularGlossiness")
        if glossy is not None:
            factor = glossy.get("diffuseFactor", WHITE)
            albedo, info = _glossy_albedo(glossy), glossy.get("diffuseTexture")
        mode = entry.get("alphaMode", "OPAQUE")
        cutoffs = {"OPAQUE": 0.0, "MASK": float(entry.get("alphaCutoff", 0.5)), "BLEND": 0.5}
        has_holes = cutoffs[mode] > 0.0
        use = None if info is None else self._use(info, user, has_opacity=has_holes)
        if "occlusionTexture" in entry:
            use = self._add_occlusion(use, entry["occlusionTexture"], user)
        self._report(entry)
        unlit = "KHR_materials_unlit" in extensions
        emission, info = self._emission(entry, extensions), entry.get("emissiveTexture")
        if unlit:
            emission = (0.0, 0.0, 0.0)
        elif any(emission) and info is not None:
            if any(albedo):
                self.losses.add("texture of emission", "surfaces shine in its mean colour")
                emission = self._mean_emission(emission, self._use(info, user).image)
            else:
                albedo, emission, unlit, use = emission, albedo, True, self._use(info, user)
        two_sided = bool(entry.get("doubleSided", False))
        opacity = float(factor[3]) if has_holes and len(factor) > 3 else 1.0
        material = FileMaterial(
            albedo,
            unlit=unlit,
            emission=emission,
            two_sided=two_sided,
            single_sided=not two_sided,
            opacity=min(max(opacity, 0.0), 1.0),
            cutoff=cutoffs[mode],
            blends=mode == "BLEND",
        )
        if use is not None:
            material = replace(material, texture=use.image, sampling=use.sampling)
        return _Look(material, use)

    def _emission(self, entry: dict[str, Any], extensions: dict[str, Any]) -> Rgb:
        strength = extensions.get("KHR_materials_emissive_strength", {}).get(
            "emissiveStrength", 1.0
        )
        factor = np.array(entry.get("emissiveFactor", (0, 0, 0)), dtype=np.float64)
        # What is no number does not shine.
        r, g, b = np.clip(np.nan_to_num(float(strength) * factor), 0.0, _MAX_EMISSION).tolist()
        return (r, g, b)

    def _report(self, entry: dict[str, Any]) -> None:
        """Name what is not drawn of a material."""
        if "normalTexture" in entry:
            self.losses.add("normal map", "surfaces are shaded without its bumps")

    def _use(self, info: dict[str, Any], user: str, *, has_opacity: bool = False) -> _TextureUse:
        """Texture of a material's entry."""
        texture = self._document["textures"][_index(info["index"])]
        webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
        source = _index(webp.get("source", texture.get("source")))
        image = self._image(source, user, has_opacity=has_opacity)
        sampler = self._sampler(texture)
        mirrored = sampler.get("wrapS") == _MIRROR, sampler.get("wrapT") == _MIRROR
        transform = info.get("extensions", {}).get("KHR_texture_transform", {})
        matrix = _texture_transform(transform)
        if any(mirrored):
            # A mirrored picture of two copies repeats as the picture itself is mirrored.
            image = self._mirror((source, has_opacity, *mirrored), image)
            matrix = matrix * np.where(mirrored, 0.5, 1.0)[:, None]
        sampling = TextureSampling(
            sampler.get("wrapS") == _CLAMP,
            sampler.get("wrapT") == _CLAMP,
            has_filter=sampler.get("magFilter") != _NEAREST,
        )
        number = _index(transform.get("texCoord", info.get("texCoord", 0)))
        return _TextureUse(image, f"TEXCOORD_{number}", matrix, sampling)

    def _sampler(self, texture: dict[str, Any]) -> dict[str, Any]:
        if "sampler" not in texture:
            return {}
        sampler: dict[str, Any] = self._document["samplers"][_index(texture["sampler"])]
        return sampler

    def _image(self, source: int, user: str, *, has_opacity: bool) -> Texture:
        key = source, has_opacity
        if key not in self._images:
            entry = self._document["images"][source]
            self._images[key] = self._load_image(entry, user, has_opacity=has_opacity)
        return self._images[key]

    def _load_image(self, entry: dict[str, Any], user: str, *, has_opacity: bool) -> Texture:
        uri = entry.get("uri")
        if uri is not None and not uri.startswith("data:"):
            return self._assets.get_texture(uri, user, has_opacity=has_opacity)
        if "bufferView" in entry:
            data = bytes(self._data.view_bytes(entry["bufferView"]))
        else:
            data = self._data.read_uri(entry["uri"])
        where = SourceLocation(str(self._path))
        return self._assets.textures.decode(data, where, has_opacity=has_opacity)

    def _mirror(self, key: tuple[int, bool, bool, bool], image: Texture) -> Texture:
        _, _, columns, rows = key
        if key not in self._mirrored:
            self._assets.textures.wait(image)
            image = np.concatenate((image, image[:, ::-1]), axis=1) if columns else image
            self._mirrored[key] = np.concatenate((image, image[::-1])) if rows else image
        return self._mirrored[key]

    def _add_occlusion(
        self, use: _TextureUse | None, info: dict[str, Any], user: str
    ) -> _TextureUse:
        """Texture times the occlusion, where both have the same coordinates."""
        occlusion = self._use(info, user)
        if use is None:
            use = replace(occlusion, image=_WHITE_TEXTURE)
        is_same = occlusion.coordinates == use.coordinates and np.array_equal(
            occlusion.uv_from_attribute, use.uv_from_attribute
        )
        if not is_same:
            self.losses.add("occlusion with coordinates of its own", "drawn without")
            return use
        key = id(use.image), id(occlusion.image), float(info.get("strength", 1.0))
        if key not in self._occluded:
            self._assets.textures.wait(use.image)
            self._assets.textures.wait(occlusion.image)
            dark = occlusion.image[..., 0]
            self._occluded[key] = multiply_texture(use.image, dark, key[2])
        return replace(use, image=self._occluded[key])

    def _mean_emission(self, factor: Rgb, image: Texture) -> Rgb:
        self._assets.textures.wait(image)
        r, g, b = (np.array(factor) * linear_light(image).mean(axis=(0, 1))).tolist()
        return r, g, b


def _glossy_albedo(glossy: dict[str, Any]) -> Rgb:
    """Light that a surface of specular and diffuse colour reflects in even light of 1."""
    diffuse = _fractions(glossy.get("diffuseFactor", WHITE)[:3])
    specular = _fractions(glossy.get("specularFactor", WHITE))
    r, g, b = (d * (1.0 - max(specular)) + s for d, s in zip(diffuse, specular, strict=True))
    return r, g, b


def _fractions(values: object) -> Rgb:
    r, g, b = clip_fractions(np.array(values, dtype=np.float64)).tolist()
    return r, g, b


def _texture_transform(transform: dict[str, Any]) -> Floats:
    """(2, 3) translation times rotation times scale, of KHR_texture_transform."""
    u, v = map(float, transform.get("offset", (0.0, 0.0)))
    a, b = map(float, transform.get("scale", (1.0, 1.0)))
    angle = float(transform.get("rotation", 0.0))
    c, s = float(cos(angle)), float(sin(angle))
    return np.array([[c * a, s * b, u], [-s * a, c * b, v]])


class _MeshReader:
    """Reader of a document's meshes."""

    def __init__(self, document: dict[str, Any], data: _Arrays, materials: _Materials) -> None:
        self._meshes = document.get("meshes", [])
        self._data = data
        self._materials = materials
        self._losses = materials.losses
        self._made: dict[int, list[FileMesh]] = {}

    def read(self, index: object, node: str, matrix: Floats) -> Iterator[FileMesh]:
        """Yield the parts of a mesh at a place; the arrays are those of all its places."""
        number = _index(index)
        if number not in self._made:
            entry = self._meshes[number]
            if any("targets" in primitive for primitive in entry["primitives"]):
                self._losses.add("morph targets", "the mesh is drawn as it is stored")
            name = str(entry.get("name", number))
            parts = [self._read(primitive, name) for primitive in entry["primitives"]]
            self._made[number] = [part for part in parts if part is not None]
        for part in self._made[number]:
            yield replace(part, file_from_mesh=matrix, node=node)

    def _read(self, primitive: dict[str, Any], name: str) -> FileMesh | None:
        mode = primitive.get("mode", _TRIANGLES)
        if mode not in (_TRIANGLES, _STRIP, _FAN):
            self._losses.add("points and lines", "not drawn")
            return None
        attributes = primitive["attributes"]
        if "POSITION" not in attributes:
            self._losses.add("mesh without positions", "not drawn")
            return None
        vertices = self._data.read(attributes["POSITION"])
        faces = self._faces(primitive, mode, len(vertices))
        look = self._materials.default
        if "material" in primitive:
            look = self._materials.get(primitive["material"])
        colours, opacities = None, None
        if "COLOR_0" in attributes:
            given = self._data.read(attributes["COLOR_0"])
            _require_rows(given, vertices, "COLOR_0")
            colours = clip_fractions(given[:, :3])
            opacities = clip_fractions(given[:, 3]) if given.shape[1] > 3 else None
        uv, material = None, look.material
        if look.use is not None and look.use.coordinates in attributes:
            at = self._data.read(attributes[look.use.coordinates]).astype(np.float64)
            _require_rows(at, vertices, look.use.coordinates)
            matrix = look.use.uv_from_attribute
            with np.errstate(invalid="ignore", over="ignore"):
                uv = matmul(at, matrix[:, :2].T) + matrix[:, 2]
        elif look.use is not None:
            self._losses.add(f"texture without {look.use.coordinates}", "drawn without")
            material = replace(material, texture=None)
        normals = None
        if "NORMAL" in attributes:
            normals = self._data.read(attributes["NORMAL"])
            _require_rows(normals, vertices, "NORMAL")
        return FileMesh(name, vertices, faces, material, uv, colours, opacities, normals)

    def _faces(
        self, primitive: dict[str, Any], mode: int, num_vertices: int
    ) -> npt.NDArray[np.integer]:
        """(n, 3) vertices of the triangles of a list, a strip or a fan."""
        if "indices" in primitive:
            indices = self._data.read(primitive["indices"])
            if len(indices) and int(indices.max()) >= num_vertices:
                raise ValueError(f"a mesh of {num_vertices} vertices has no {indices.max()}")
        else:
            indices = np.arange(num_vertices, dtype=np.uint32)
        if mode == _TRIANGLES:
            return indices[: len(indices) // 3 * 3].reshape(-1, 3)
        corner = np.arange(max(0, len(indices) - 2))[:, None]
        if mode == _FAN:
            return indices[np.concatenate((corner + 1, corner + 2, 0 * corner), axis=1)]
        odd = corner % 2  # every other triangle of a strip is wound the other way round
        return indices[np.concatenate((corner, corner + 1 + odd, corner + 2 - odd), axis=1)]


def _require_rows(values: npt.NDArray[Any], vertices: npt.NDArray[Any], name: str) -> None:
    if len(values) != len(vertices) or values.ndim != 2:
        raise ValueError(f"{name} has {len(values)} elements for {len(vertices)} vertices")
