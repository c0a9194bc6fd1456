"""What readers of mesh files share: files beside a mesh file, its parts, and what is not drawn.

`MeshAssets` reads the files that a mesh file refers to: materials, buffers and images inside its
folder, or inside its model's where the folder is called `meshes`, as in Gazebo's models. Names are
those of another machine at times: percent-encoded, with backslashes, in another case, with paths
that exist nowhere else.

`FileMesh` is a mesh as a file has it, in the file's frame; `Losses` collects what the format
says and no renderer draws.
"""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import field
from pathlib import Path
from urllib.parse import unquote

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.textures import (
    REPEATED,
    Texture,
    TextureReader,
    TextureSampling,
    read_within,
)
from catoptra_server.world.world_description import MeshFile, Rgb

log = logging.getLogger(__name__)
WHITE: Rgb = (1.0, 1.0, 1.0)
# Without a texture and without a colour, in formats that define none.
MID_GREY: Rgb = (0.5, 0.5, 0.5)
# Byte 188 of sRGB is half the light.
_GREY: Texture = np.full((1, 1, 3), 188, dtype=np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class FileMaterial:
    """Material of a mesh file, as far as the shading model goes."""

    albedo: Rgb = MID_GREY
    """Linear; a texture and colours at vertices multiply it."""
    texture: Texture | None = None
    unlit: bool = False
    """Whether the surface is shown at its albedo, whatever the lights."""
    sampling: TextureSampling = REPEATED
    emission: Rgb = (0.0, 0.0, 0.0)
    """Linear radiance of its own."""
    two_sided: bool = False
    """Whether the file says that backs are lit by the opposite normal."""
    single_sided: bool = False
    """Whether the file says that backs are not seen."""
    opacity: float = 1.0
    """Times that of texture and vertices."""
    cutoff: float = 0.0
    """Opacity below which a point is no surface; 0 for surfaces without holes."""
    blends: bool = False
    """Whether what lies behind shows through; the cutoff is then one half."""


@dataclass(frozen=True, slots=True, eq=False)
class FileMesh:
    """Triangles of one material, as a mesh file has them."""

    name: str
    """Name for messages."""
    vertices: npt.NDArray[np.floating]
    """(v, 3) in the file's frame and unit."""
    faces: npt.NDArray[np.integer]
    """(n, 3) vertices of each triangle, counter-clockwise from outside."""
    material: FileMaterial = FileMaterial()
    uv: Floats | None = None
    """(v, 2) texture coordinates, (0, 0) at the image's top left; None without a texture."""
    colours: Floats | None = None
    """(v, 3) linear colours at vertices."""
    opacities: Floats | None = None
    """(v,) opacities at vertices."""
    normals: npt.NDArray[np.floating] | None = None
    """(v, 3) normals at vertices, of any length, by which light is reflected; None: flat."""
    face_colours: Floats | None = None
    """(n, 3) linear colours of triangles."""
    file_from_mesh: Floats = field(default_factory=lambda: np.eye(4))
    """(4, 4) position in the file."""
    node: str = ""
    """Node of a glTF file; empty in other formats."""


class Losses:
    """What a file says and no renderer draws: each feature once, with its effect on the picture."""

    def __init__(self, path: Path) -> None:
        """Collect for a file."""
        self._path = path
        self._counts: Counter[tuple[str, str]] = Counter()

    def add(self, feature: str, effect: str) -> None:
        """Count a feature once more."""
        self._counts[feature, effect] += 1

    def log(self) -> None:
        """Log a warning for each feature."""
        for (feature, effect), count in self._counts.items():
            times = "once" if count == 1 else f"{count} times"
            log.warning("%s: %s: %s (%s)", self._path, feature, effect, times)


class MeshAssets:
    """Reader of the files beside a mesh file."""

    def __init__(self, shape: MeshFile, textures: TextureReader, losses: Losses) -> None:
        """Read files inside the folder of a mesh file.

        Args:
            shape: the mesh file.
            textures: reader of the scene's textures.
            losses: missing textures, where the world goes on without.
        """
        self._shape = shape
        self.textures = textures
        self._losses = losses
        folder = shape.path.resolve().parent
        self._folder = folder
        self._root = folder.parent if folder.name == "meshes" else folder

    def get(self, name: str) -> bytes:
        """Content of a file.

        Raises:
            FileNotFoundError: There is no such file inside the folder.
            ConfigError: The file exceeds the budget.
        """
        return read_within(self._find(name), self.textures.memory, key="File")

    __getitem__ = get

    def get_texture(self, name: str, user: str, *, has_opacity: bool = False) -> Texture:
        """Texture of a file; grey where it is missing, and the world goes on without.

        Args:
            name: the file as the mesh file names it.
            user: the material, for messages.
            has_opacity: whether the image's opacity counts.

        Raises:
            ConfigError: The file is missing, no image, or exceeds the budget.
        """
        try:
            path = self._find(name)
        except FileNotFoundError as error:
            self.report_missing(name, user, error)
            return _GREY
        return self.textures.load(path, has_opacity=has_opacity)

    def report_missing(self, name: str, user: str, error: FileNotFoundError) -> None:
        """Count a missing file among the losses, where the world goes on without.

        Raises:
            ConfigError: The world does not.
        """
        if self._shape.has_optional_textures:
            self._losses.add(f"missing {name}", f"{user} is drawn without")
            return
        raise ConfigError(
            SourceLocation(str(self._shape.path)),
            key=user,
            value=name,
            expected=f"{error}; MissingTextures=grey draws the mesh without",
        ) from error

    def _find(self, name: str) -> Path:
        plain = name.strip().replace("\\", "/").removeprefix("file://").lstrip("/")
        for text in dict.fromkeys((plain, unquote(plain))):
            last = text.rsplit("/", 1)[-1]
            # Gazebo has textures of bare names beside the folder of meshes.
            for candidate in dict.fromkeys((text, last, f"../materials/textures/{last}")):
                path = self._find_inside(candidate)
                if path is not None:
                    return path
        raise FileNotFoundError(f"a file inside {self._root}")

    def _find_inside(self, name: str) -> Path | None:
        """A file inside the root, links followed, or the only one of a name in another case."""
        try:
            path = (self._folder / name).resolve()
            if not path.is_relative_to(self._root):
                return None
            if path.is_file():
                return path
            if not path.parent.is_dir():
                return None
            same = [one for one in path.parent.iterdir() if one.name.lower() == path.name.lower()]
        except (OSError, ValueError):  # names that no file system has
            return None
        inside = [one.resolve() for one in same if one.resolve().is_relative_to(self._root)]
        return inside[0] if len(inside) == 1 and inside[0].is_file() else None
