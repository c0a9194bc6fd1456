"""Image files as textures; the only module of the server that imports Pillow.

An image file announces its size in the first bytes, long before Pillow decodes it: 22 kB of a PNG
are 530 MB of pixels. The size is compared with the memory budget in between.
"""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_server.memory_budget import BYTES_PER_TEXEL, MemoryBudget

Texture = npt.NDArray[np.uint8]  # (h, w, 3) sRGB, row 0 at the top

# Pillow's readers of other formats decode with programs of the system (EPS) or are rarely used.
_FORMATS = ("PNG", "JPEG", "BMP", "GIF", "PPM", "TGA", "TIFF", "WEBP")


def load_texture(path: Path, memory: MemoryBudget | None = None) -> Texture:
    """Load an image file as (h, w, 3) uint8 sRGB.

    Args:
        path: the file.
        memory: budget of the scene; None for a budget of this texture's own.

    Raises:
        ConfigError: The file is no readable image, or larger than the budget.
    """
    where = SourceLocation(str(path))
    with _open_image(path, where) as image:
        reserve_texels(image.size, memory or MemoryBudget(), where)
        return decode_image(image, where)


def reserve_texels(size: tuple[int, int], memory: MemoryBudget, where: SourceLocation) -> None:
    """Count the memory of a texture of (width, height) texels.

    Raises:
        ConfigError: The budget is exceeded.
    """
    width, height = size
    memory.reserve(
        BYTES_PER_TEXEL * width * height,
        where=where,
        key="Texture",
        value=f"{width} x {height} px",
        remedy="a smaller image",
    )


def read_image_size(data: bytes, where: SourceLocation) -> tuple[int, int]:
    """Width and height that the first bytes of an image file state.

    Raises:
        ConfigError: The bytes are no image.
    """
    with _open_image(io.BytesIO(data), where) as image:
        width, height = image.size
        return int(width), int(height)


def decode_image(image: Any, where: SourceLocation) -> Texture:
    """(h, w, 3) uint8 sRGB of a Pillow image, read-only.

    Raises:
        ConfigError: The image is damaged, or of a format that is not read.
    """
    if image.format is not None and image.format not in _FORMATS:
        raise _image_error(where, f"its format {image.format} is not read")
    try:
        texture = np.array(image.convert("RGB"))
    except (OSError, SyntaxError, ValueError) as error:  # Pillow reports damage by all of these
        raise _image_error(where, str(error)) from error
    texture.setflags(write=False)
    return texture


def _open_image(file: Path | IO[bytes], where: SourceLocation) -> Any:
    """Pillow image of a file whose header alone is read."""
    # Imported on demand: most worlds have no texture.
    from PIL import Image, UnidentifiedImageError

    with warnings.catch_warnings():
        # Large images are rejected by the memory that they take.
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        try:
            return Image.open(file, formats=_FORMATS)
        except UnidentifiedImageError as error:
            reason = f"it is damaged, or none of {', '.join(_FORMATS)}"
            raise _image_error(where, reason) from error
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            raise _image_error(where, str(error)) from error


def _image_error(where: SourceLocation, reason: str) -> ConfigError:
    expected = f"an image file ({reason})"
    return ConfigError(where, key="Texture", value=where.file, expected=expected)
