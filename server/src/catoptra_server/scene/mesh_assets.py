"""Files that a mesh file names: materials, buffers and images, read within a memory budget."""

from __future__ import annotations

from pathlib import Path

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.memory_budget import MemoryBudget
from catoptra_server.scene.texture_files import read_image_size, reserve_texels

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
