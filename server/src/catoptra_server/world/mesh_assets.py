"""What a mesh file names or contains beside its triangles, counted before memory is taken for it.

`MeshAssets` reads the files that a mesh file refers to: materials, buffers and images inside its
folder. `reserve_gltf` counts what a glTF file announces, since a few bytes of JSON can name arrays
of gigabytes: an accessor without a buffer view is zeros of any length, buffer views may overlap,
and an image may be of any size. Source: glTF 2.0, 3.6 and 4.4.3.
"""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.runtime.memory import MemoryBudget
from catoptra_server.world.textures import read_image_size, reserve_texels

_IMAGE_SUFFIXES = frozenset(
    (".png", ".jpg", ".jpeg", ".bmp", ".gif", ".ppm", ".tga", ".tif", ".tiff", ".webp")
)


class MeshAssets:
    """Reader of the files beside a mesh file, in the form that trimesh calls a resolver."""

    def __init__(self, folder: Path, memory: MemoryBudget) -> None:
        """Read files inside a folder.

        Args:
            folder: folder of the mesh file; files outside are not read.
            memory: budget for reading one mesh file.
        """
        self._folder = folder.resolve()
        self._memory = memory
        self.rejection: ConfigError | None = None
        """Error of the first file that was rejected: trimesh loads a mesh without its images."""
        self.missing: list[str] = []
        """Names that no file inside the folder has."""

    def get(self, name: str) -> bytes:
        """Content of a file.

        Raises:
            FileNotFoundError: There is no such file inside the folder.
            ConfigError: The file, or the image in it, exceeds the budget.
        """
        path = self._find(name)
        try:
            return self._read(path)
        except ConfigError as error:
            self.rejection = self.rejection or error
            raise

    __getitem__ = get

    def _find(self, name: str) -> Path:
        # Files are often written on another machine: the bare name is tried last.
        for candidate in (name.strip(), name.strip().lstrip("/"), Path(name.strip()).name):
            path = (self._folder / candidate).resolve()
            if path.is_relative_to(self._folder) and path.is_file():
                return path
        self.missing.append(name)
        raise FileNotFoundError(f"it refers to {name}, and there is no such file beside it")

    def _read(self, path: Path) -> bytes:
        where = SourceLocation(str(path))
        self._memory.reserve(
            path.stat().st_size,
            where=where,
            key="File",
            value=f"{path.stat().st_size} bytes",
            remedy="a smaller file",
        )
        data = path.read_bytes()
        if path.suffix.lower() in _IMAGE_SUFFIXES:
            reserve_texels(read_image_size(data, where), self._memory, where)
        return data


_MAGIC = b"glTF"
_DATA_URI = "data:"
_COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}


def reserve_gltf(
    data: bytes, memory: MemoryBudget, where: SourceLocation, read_asset: Callable[[str], bytes]
) -> None:
    """Count the arrays and embedded images that a GLB or glTF file announces.

    Args:
        data: the file.
        memory: budget for reading the file.
        where: the file's name.
        read_asset: content of a file that this one names.

    Raises:
        ConfigError: The budget is exceeded, or an embedded image is none.
        ValueError, KeyError, TypeError, IndexError, AttributeError, struct.error: The file is no
            glTF.
    """
    header, binary = _split_glb(data) if data[:4] == _MAGIC else (json.loads(data), b"")
    arrays = sum(_accessor_bytes(accessor) for accessor in header.get("accessors", []))
    arrays += sum(_non_negative(view["byteLength"]) for view in header.get("bufferViews", []))
    memory.reserve(
        arrays,
        where=where,
        key="File",
        value=f"{len(header.get('accessors', []))} accessors",
        remedy="a mesh file with fewer or smaller accessors and buffer views",
    )
    for image in _embedded_images(header, binary, read_asset):
        reserve_texels(read_image_size(image, where), memory, where)


def _split_glb(data: bytes) -> tuple[dict[str, Any], bytes]:
    """JSON and binary chunk of a GLB file."""
    (json_length,) = struct.unpack_from("<I", data, 12)
    end = 20 + json_length
    return json.loads(data[20:end]), data[end + 8 :]


def _accessor_bytes(accessor: dict[str, Any]) -> int:
    size = _COMPONENTS[accessor["type"]] * _COMPONENT_BYTES[accessor["componentType"]]
    return _non_negative(accessor["count"]) * size


def _non_negative(number: object) -> int:
    # A negative count would hide others in the sum.
    if not isinstance(number, int) or number < 0:
        raise ValueError(f"a size is a whole number of at least 0, not {number!r}")
    return number


def _embedded_images(
    header: dict[str, Any], binary: bytes, read_asset: Callable[[str], bytes]
) -> Iterator[bytes]:
    """Yield the images inside the file; those in files of their own are counted when read."""
    for image in header.get("images", []):
        if "bufferView" in image:
            view = header["bufferViews"][image["bufferView"]]
            uri = header["buffers"][view["buffer"]].get("uri")
            buffer = binary if uri is None else _read_uri(uri, read_asset)
            start = view.get("byteOffset", 0)
            yield buffer[start : start + view["byteLength"]]
        elif image["uri"].startswith(_DATA_URI):
            yield _read_uri(image["uri"], read_asset)


def _read_uri(uri: str, read_asset: Callable[[str], bytes]) -> bytes:
    if not uri.startswith(_DATA_URI):
        return read_asset(uri)
    return base64.b64decode(uri.partition(",")[2])
