"""Textures: image files, their coarser levels, and the appearance of meshes.

Image files; no other module of the server imports Pillow. A file announces its size in the first
bytes, long before Pillow decodes it: 22 kB of a PNG are 530 MB of pixels. The size is compared with
the memory budget in between.

Levels: no texel is finer than samples. A sample covers a part of a surface; steps to the two
neighbouring samples, in texels, are its footprint. Where these are longer than a texel, a look-up
in the image itself picks single texels of many: a distant pattern flickers. Each level halves the
one before by the mean of what its texels cover, so a look-up in the level of the footprint averages
all of it, at the cost of two look-ups. The footprint is an ellipse, a level's texel is a square. At
a grazing angle the ellipse is long: the level of the longer axis would blur the texture across, the
level of the shorter one would leave it aliased. As a compromise the longer axis counts at most
`MAX_STRETCH` times the shorter. Source: Williams 1983 for levels, Igehy 1999 for steps on a
surface, Heckbert 1989 for the ellipse. Twins: render/trace/kernel/src/texture_levels.h,
glsl/include/texture_levels.glsl.

Appearance of a mesh: colours of corners, faces or material, texture, unlit, as far as the shading
model goes. Colours between the corners of a triangle are interpolated in linear light, as glTF
defines; a mesh whose triangles have one colour each has no corner colours.
"""

from __future__ import annotations

import hashlib
import io
import math
import warnings
from collections.abc import Callable
from concurrent import futures
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.optics.elementary import einsum
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.runtime.memory import (
    BYTES_PER_TEXEL,
    LARGE_SCENE_BYTES_PER_TEXEL,
    MAX_LIGHT_TEXELS,
    PEAK_BYTES_PER_TEXEL,
    MemoryBudget,
    count_processors,
)
from catoptra_server.world.shading import decode_texels, sample_texture
from catoptra_server.world.triangles import select_rows
from catoptra_server.world.world_description import Rgb, linear_from_srgb, srgb_from_linear

# (h, w, 3) sRGB, row 0 at the top; or (h, w, 4) with opacity, 255 = opaque, for holes
Texture = npt.NDArray[np.uint8]

# Pillow's readers of other formats decode with programs of the system (EPS) or are rarely used.
_FORMATS = ("PNG", "JPEG", "BMP", "GIF", "PPM", "TGA", "TIFF", "WEBP")


class TextureReader:
    """Image files of one scene. Each is read and held once, by its content, under all its names.

    Sizes are counted by the first bytes, one after the other; texels are decoded by other threads
    while the scene is read on.
    """

    def __init__(self, memory: MemoryBudget | None = None, *, has_texels: bool = True) -> None:
        """Read nothing yet.

        Args:
            memory: budget of the scene, None for the default.
            has_texels: whether images are decoded; else they are white, for their sizes alone.
        """
        self.memory = memory or MemoryBudget()
        self.has_texels = has_texels
        self._light_texels_left = MAX_LIGHT_TEXELS
        self._textures: dict[tuple[Path | bytes, bool], Texture] = {}
        self._decoding: dict[int, futures.Future[None]] = {}
        self._busy: list[futures.Future[None]] = []
        self._pool = futures.ThreadPoolExecutor(count_processors())

    def __enter__(self) -> TextureReader:
        """Read textures; at the end of the block the threads end."""
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)

    def load_by_name(self, name: str) -> Texture:
        """Texture of a name of `named_textures`."""
        # Imported on demand: most worlds have none.
        from catoptra_server.world.named_textures import SIDE_PX, load_named_texture

        key = name.encode(), False
        if key not in self._textures:
            size = SIDE_PX if self.has_texels else 1
            self._reserve_held(size, size, SourceLocation(name))
            if not self.has_texels:
                return self._textures.setdefault(key, _make_white(3))
            texture = self._textures[key] = np.zeros((size, size, 3), dtype=np.uint8)
            # The first start makes it: half of the time of a furnished world.
            making = self._pool.submit(_fill, texture, partial(load_named_texture, name))
            self._decoding[id(texture)] = making
        return self._textures[key]

    def load(self, path: Path, *, has_opacity: bool = False) -> Texture:
        """Texture of an image file, as by `decode`; errors likewise."""
        key = path.resolve(), has_opacity
        if key not in self._textures:
            where = SourceLocation(str(path))
            try:
                data = read_within(path, self.memory, key="Texture")
            except OSError as error:
                raise _image_error(where, str(error)) from error
            self._textures[key] = self.decode(data, where, has_opacity=has_opacity)
        return self._textures[key]

    def decode(self, data: bytes, where: SourceLocation, *, has_opacity: bool = False) -> Texture:
        """(h, w, 3) sRGB bytes of an image file's content; (h, w, 4) with opacity, where wanted.

        They are there once `wait` returns.

        Raises:
            ConfigError: The bytes are no image, or larger than the budget.
        """
        key = hashlib.sha256(data).digest(), has_opacity
        if key not in self._textures:
            image = _open_image(data, where)
            width, height = image.size
            peak = PEAK_BYTES_PER_TEXEL * width * height
            self._reserve(self.memory.for_reading(), peak, width, height, where)
            self._reserve_held(width, height, where)
            channels = 4 if has_opacity and not image.mode.startswith("I") else 3
            if not self.has_texels:
                return self._textures.setdefault(key, _make_white(channels))
            bordered = make_texels(height, width, channels, np.uint8)
            texture = self._textures[key] = bordered[1:-1, 1:-1]
            # Files wait in memory for their threads: not all of them.
            self._busy = [one for one in self._busy if not one.done()]
            if len(self._busy) > _MAX_WAITING:
                futures.wait(self._busy, return_when=futures.FIRST_COMPLETED)
            decoding = self._pool.submit(_decode_image, image, where, bordered, texture)
            self._busy.append(decoding)
            self._decoding[id(texture)] = decoding
        return self._textures[key]

    def _reserve_held(self, width: int, height: int, where: SourceLocation) -> None:
        """Count an image: the first texels as light, those of a large scene are counted more."""
        light = min(width * height, self._light_texels_left)
        self._light_texels_left -= light
        num_bytes = BYTES_PER_TEXEL * light
        num_bytes += LARGE_SCENE_BYTES_PER_TEXEL * (width * height - light)
        self._reserve(self.memory, num_bytes, width, height, where)

    @staticmethod
    def _reserve(
        memory: MemoryBudget, num_bytes: int, width: int, height: int, where: SourceLocation
    ) -> None:
        memory.reserve(
            num_bytes,
            where=where,
            key="Texture",
            value=f"{width} x {height} px",
            remedy="a smaller image",
        )

    def wait(self, texture: Texture | None) -> None:
        """Wait until a texture is decoded.

        Raises:
            ConfigError: The image file is damaged.
        """
        if (decoding := self._decoding.pop(id(texture), None)) is not None:
            decoding.result()


def _fill(texture: Texture, load: Callable[[], Texture]) -> None:
    texture[:] = load()
    texture.setflags(write=False)


def _make_white(channels: int) -> Texture:
    return np.full((1, 1, channels), 255, dtype=np.uint8)


# A few a thread, so that no thread waits for files.
_MAX_WAITING = 8


def read_within(path: Path, memory: MemoryBudget, *, key: str) -> bytes:
    """Content of a file that fits into a budget by itself; it is not counted further.

    Raises:
        OSError: There is no such file.
        ConfigError: The file is larger.
    """
    size = path.stat().st_size
    memory.for_reading().reserve(
        size,
        where=SourceLocation(str(path)),
        key=key,
        value=f"{size} bytes",
        remedy="a smaller file",
    )
    return path.read_bytes()


def make_texels(height: int, width: int, channels: int, dtype: Any) -> npt.NDArray[Any]:
    """(h + 2, w + 2, c) zeros: texels within a border of one, as the kernel reads them."""
    # One number more: the kernel reads four at once.
    buffer = np.zeros((height + 2) * (width + 2) * channels + 1, dtype=dtype)
    return buffer[:-1].reshape(height + 2, width + 2, channels)


def find_border(texels: npt.NDArray[Any]) -> npt.NDArray[Any] | None:
    """(h + 2, w + 2, c) array of `make_texels` that texels are the inside of; None without one."""
    height, width, channels = texels.shape
    shape = height + 2, width + 2, channels
    buffer = texels.base
    if not isinstance(buffer, np.ndarray) or buffer.shape != (math.prod(shape) + 1,):
        return None
    bordered = buffer[:-1].reshape(shape)
    inside = bordered[1:-1, 1:-1].__array_interface__
    return bordered if texels.__array_interface__["data"][0] == inside["data"][0] else None


def repeat_border(bordered: npt.NDArray[Any]) -> None:
    """Write the border of texels: the texels of the opposite edges."""
    bordered[0], bordered[-1] = bordered[-2], bordered[1]
    bordered[:, 0], bordered[:, -1] = bordered[:, -2], bordered[:, 1]


def _decode_image(
    image: Any, where: SourceLocation, bordered: npt.NDArray[np.uint8], texture: Texture
) -> None:
    """Write the texels of a Pillow image, read-only then, and the border around them."""
    try:
        if image.mode.startswith("I"):
            # Grey of 16 bits, of which Pillow's own conversion keeps the lower eight.
            texture[...] = np.clip(np.rint(np.array(image) / 257.0), 0.0, 255.0)[..., None]
        else:
            mode = "RGB" if texture.shape[-1] == 3 else "RGBA"
            texture[...] = np.asarray(image if image.mode == mode else image.convert(mode))
    except (OSError, SyntaxError, ValueError) as error:  # Pillow reports damage by all of these
        raise _image_error(where, str(error)) from error
    repeat_border(bordered)
    texture.setflags(write=False)


def _open_image(data: bytes, where: SourceLocation) -> Any:
    """Pillow image of a file whose header alone is read."""
    # Imported on demand: most worlds have no texture.
    from PIL import Image, UnidentifiedImageError
    from PIL.PngImagePlugin import PngImageFile

    file, is_png = io.BytesIO(data), data.startswith(b"\x89PNG")
    with warnings.catch_warnings():
        # Large images are rejected by the memory that they take.
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        try:
            # `open` loads five readers where there is no file name: 10 ms.
            image = PngImageFile(file) if is_png else Image.open(file, formats=_FORMATS)
        except UnidentifiedImageError as error:
            reason = f"it is damaged, or none of {', '.join(_FORMATS)}"
            raise _image_error(where, reason) from error
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            raise _image_error(where, str(error)) from error
    if image.format is not None and image.format not in _FORMATS:
        raise _image_error(where, f"its format {image.format} is not read")
    return image


def _image_error(where: SourceLocation, reason: str) -> ConfigError:
    expected = f"an image file ({reason})"
    return ConfigError(where, key="Texture", value=where.file, expected=expected)


MAX_STRETCH = 3.0
"""Longer axis of a footprint over the shorter, beyond which it is not averaged any further.

Chosen in tests/measurements/texture_aliasing.py."""


@dataclass(frozen=True, slots=True)
class TextureSampling:
    """How a texture continues beyond its edges, and what is between its texels."""

    clamps_u: bool = False
    """Whether the edge's texels continue to the left and right; else the texture repeats."""
    clamps_v: bool = False
    """Likewise above and below."""
    has_filter: bool = True
    """Whether texels are interpolated where they are larger than samples."""

    def place(self, uv: Floats, size: tuple[int, int], *, is_image: Bools) -> Floats:
        """(n, 2) coordinates at which a look-up that repeats and interpolates gives this one's.

        Args:
            uv: (n, 2) coordinates.
            size: (width, height) of the level.
            is_image: (n,) look-ups in the image itself, alone.
        """
        placed, sides = uv.copy(), np.asarray(size, dtype=np.float64)
        if not self.has_filter:
            placed[is_image] = (np.floor(uv[is_image] * sides) + 0.5) / sides
        for axis, clamps in enumerate((self.clamps_u, self.clamps_v)):
            if clamps:
                half = 0.5 / sides[axis]
                placed[:, axis] = np.clip(placed[:, axis], half, 1.0 - half)
        return placed


REPEATED = TextureSampling()
"""Textures of worlds' own materials."""

Levels = tuple[npt.NDArray[Any], ...]
"""(h, w, 3) sRGB bytes of the image, then linear float32 texels of each coarser level, to one
texel; (h, w, 4) with opacity last."""


def build_levels(image: Texture) -> Levels:
    """The image and its coarser levels; each side is half the one before, rounded down, as in
    OpenGL."""
    levels: list[npt.NDArray[Any]] = [image]
    planes = np.zeros((0, 0, 0), dtype=np.float32)
    while max(levels[-1].shape[:2]) > 1:
        planes = _halve_rows(planes) if len(levels) > 1 else _halve_bytes(image)
        planes = _halve_rows(planes.swapaxes(1, 2)).swapaxes(1, 2)
        levels.append(np.moveaxis(planes, 0, -1))
    return tuple(levels)


# The light of a whole image would be four times as large as the image.
_ROWS_AT_ONCE = 64


def _halve_bytes(image: Texture) -> npt.NDArray[np.float32]:
    """(c, h // 2, w) planes of an image's light, as of `_halve_rows`.

    A plane for each channel from the start: NumPy's operations on rows of three take several times
    as long, and to sort such rows into planes takes a third of all levels' time.
    """
    step = len(image) if len(image) % 2 else _ROWS_AT_ONCE
    # Light of each byte as red, green, blue and opacity.
    tables = decode_texels(np.arange(256, dtype=np.uint8)[:, None].repeat(4, axis=1)).T.copy()
    planes = [
        [
            _halve_rows(table.take(plane[first : first + step])[None])
            for first in range(0, len(plane), step)
        ]
        for table, plane in zip(tables, np.moveaxis(image, -1, 0), strict=False)
    ]
    return np.concatenate([np.concatenate(parts, axis=1) for parts in planes])


def _halve_rows(planes: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """(c, h // 2, w) planes of half as many rows, together as high: means by the covered parts."""
    count = planes.shape[1]
    half = count // 2
    if half == 0:
        return planes
    if count % 2 == 0:
        return 0.5 * (planes[:, 0::2] + planes[:, 1::2])
    # Row k of n covers 2 + 1/n old rows, from k (2 + 1/n) on: a part of the first, the second,
    # a part of the third.
    row = np.arange(half, dtype=np.float32)[:, None]
    parts = (half - row) * planes[:, 0:-2:2] + half * planes[:, 1:-1:2]
    parts += (row + 1.0) * planes[:, 2::2]
    return np.asarray(parts / np.float32(count), dtype=np.float32)


def uv_gradients(corners: Floats, uv: Floats) -> Floats:
    """(n, 2, 3) change of texture coordinates a metre, in the planes of (n, 3, 3) triangles.

    Zero for a triangle without area.

    Args:
        corners: positions, metres.
        uv: (n, 3, 2) texture coordinates of the corners.
    """
    edges = corners[:, 1:] - corners[:, :1]
    # The dual of the two edges within their plane.
    gram = einsum("nai,nbi->nab", edges, edges)
    area = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
    adjugate = np.stack((gram[:, 1, 1], -gram[:, 0, 1], -gram[:, 1, 0], gram[:, 0, 0]), axis=-1)
    inverse = adjugate.reshape(-1, 2, 2) / np.where(area > 0.0, area, 1.0)[:, None, None]
    dual = einsum("nab,nbi->nai", inverse, edges)
    gradient: Floats = einsum("nak,nai->nki", uv[:, 1:] - uv[:, :1], dual)
    return gradient


def uv_steps(
    gradients: Floats, normals: Floats, hits: Floats, directions: Floats, ray_steps: Floats
) -> Floats:
    """(n, 2, 2) texture coordinates from each sample to its two neighbours (second axis).

    Args:
        gradients: (n, 2, 3) of the coordinates, as `uv_gradients` returns.
        normals: (n, 3) of the surfaces, of any length but zero.
        hits: (n,) distances along the directions, metres.
        directions: (n, 3) unit directions of the rays.
        ray_steps: (n, 2, 3) from each direction to its neighbours'.
    """
    # A ray beside this one meets the plane where it has gone further, or less far, by the slope.
    cosine = einsum("ni,ni->n", normals, directions)
    slopes = einsum("ni,nsi->ns", normals, ray_steps)
    # A ray within the plane has no footprint on it: the image itself is as good as any level.
    slopes = slopes / np.where(cosine == 0.0, np.inf, cosine)[:, None]
    on_plane = ray_steps - slopes[..., None] * directions[:, None]
    steps: Floats = hits[:, None, None] * einsum("nki,nsi->nsk", gradients, on_plane)
    return steps


def footprint_texels(steps: Floats, size: tuple[int, int]) -> Floats:
    """(n,) texels across the footprint of samples, of which one level's texel should be.

    Args:
        steps: (n, 2, 2) coordinates to the neighbouring samples, as `uv_steps` returns.
        size: (width, height) of the image.
    """
    texels = steps * np.asarray(size, dtype=np.float64)
    squares = np.square(texels).sum(axis=(-2, -1))
    area = np.abs(texels[:, 0, 0] * texels[:, 1, 1] - texels[:, 0, 1] * texels[:, 1, 0])
    # Longer axis squared, as the larger singular value: in this form nothing cancels.
    root = np.sqrt(np.maximum(squares - 2.0 * area, 0.0) * (squares + 2.0 * area))
    longer = np.sqrt(0.5 * (squares + root))
    # The shorter axis is the area over the longer one.
    limit = MAX_STRETCH * area / np.where(longer > 0.0, longer, 1.0)
    result: Floats = np.minimum(longer, limit)
    return result


def sample_levels(
    levels: Levels, uv: Floats, footprint: Floats, sampling: TextureSampling = REPEATED
) -> Floats:
    """(n, 3) linear colours at (n, 2) coordinates, averaged over (n,) footprints in texels.

    A footprint of up to one texel reads the image itself, as `sample_texture` does; one from 2^k to
    1.5 2^k texels level k alone, since that halves the look-ups. From there on the colour is linear
    in the footprint, up to level k + 1.
    """
    fraction, exponent = np.frexp(np.maximum(footprint, 1.0))
    level = np.minimum(exponent - 1, len(levels) - 1)
    weight = np.where(level < len(levels) - 1, np.maximum(4.0 * fraction - 3.0, 0.0), 0.0)[:, None]
    colours = np.zeros((len(uv), levels[0].shape[-1]))
    for number, (fine, coarse) in enumerate(zip(levels, (*levels[1:], levels[-1]), strict=True)):
        rays = np.flatnonzero(level == number)
        is_image = (weight[rays, 0] == 0.0) & (number == 0)
        one, other = (
            sample_texture(
                each,
                sampling.place(uv[rays], (each.shape[1], each.shape[0]), is_image=is_image),
            )
            for each in (fine, coarse)
        )
        colours[rays] = (1.0 - weight[rays]) * one + weight[rays] * other
    return colours


@dataclass(frozen=True, slots=True, eq=False)
class MeshAppearance:
    """Appearance of n triangles."""

    uv: Floats
    """(n, 3, 2) texture coordinates."""
    albedo: Floats
    """(n, 3) linear; the mean of the corners where these differ."""
    corner_albedo: Floats | None
    """(n, 3, 3) linear albedos at the corners; None for triangles of one albedo each."""
    texture: Texture | None
    """None for a mesh of plain colours."""
    unlit: bool
    """Whether the file shows the mesh at its albedo, whatever the lights."""
    sampling: TextureSampling = REPEATED
    """How the texture is sampled."""
    emission: Rgb = (0.0, 0.0, 0.0)
    """Linear radiance of its own, that is added to reflected light."""
    corner_normals: Floats | None = None
    """(n, 3, 3) unit normals at the corners, by which light is reflected between; None: flat."""
    two_sided: bool = False
    """Whether backs are lit by the opposite normal; else by that of the front."""
    single_sided: bool = False
    """Whether backs are not seen; they cast shadows, and sensors meet them."""
    coverage: Floats | None = None
    """(n, 3) opacity at the corners, over that of the emptiest point which is a surface, times the
    texture's opacity: holes are where it is below 1. None without holes."""
    gloss: tuple[float, float] = (0.0, 0.0)
    """Reflectance along the normal, and roughness, as of `SurfaceGloss`; 0: matt."""
    blends: bool = False
    """Whether what lies behind shows through, by an opacity of half the coverage."""

    def select(self, mask: Bools) -> MeshAppearance:
        """Appearance of the triangles of a (n,) mask."""
        at_corners, normals = self.corner_albedo, self.corner_normals
        return replace(
            self,
            uv=select_rows(self.uv, mask),
            albedo=select_rows(self.albedo, mask),
            corner_albedo=None if at_corners is None else select_rows(at_corners, mask),
            corner_normals=None if normals is None else select_rows(normals, mask),
            coverage=None if self.coverage is None else select_rows(self.coverage, mask),
        )


def no_texture_coordinates(num_triangles: int) -> Floats:
    """(n, 3, 2) zeros that take no memory, for triangles without a texture."""
    return np.broadcast_to(0.0, (num_triangles, 3, 2))


def corner_albedos(
    vertex_albedo: Floats, faces: npt.NDArray[np.integer]
) -> tuple[Floats, Floats | None]:
    """(n, 3) mean albedos of triangles with (v, 3) albedos at vertices, and those at corners."""
    corners = vertex_albedo.take(faces, axis=0)
    first, second, third = np.moveaxis(corners, 1, 0)
    if (first == second).all() and (first == third).all():
        return first.copy(), None  # a copy: the view would keep all corners
    return (first + second + third) / 3.0, corners


def linear_light(colours: npt.ArrayLike) -> Floats:
    """(..., 3) linear light of (..., 3 or 4) sRGB colours.

    Whole numbers are fractions of the largest one of their type; fractions beyond [0, 1] and NaN
    are clipped.
    """
    values = np.asarray(colours)[..., :3]
    if values.dtype == np.uint8:
        # A look-up is a hundred times as fast as the power.
        return linear_from_srgb(np.arange(256) / 255.0).take(values)
    limit = np.iinfo(values.dtype).max if values.dtype.kind in "iu" else 1.0
    return linear_from_srgb(clip_fractions(values / limit))


def clip_fractions(values: npt.NDArray[np.floating]) -> Floats:
    """Values in [0, 1]; what is no number counts as 0."""
    return np.clip(np.nan_to_num(values.astype(np.float64)), 0.0, 1.0)


def multiply_texture(image: Texture, factors: npt.NDArray[np.uint8], strength: float) -> Texture:
    """(h, w, 3) sRGB of a texture times (h2, w2) factors, 255 = 1, of a strength from 0 to 1.

    In linear light; the smaller one is enlarged.
    """
    from PIL import Image

    height, width = (max(image.shape[side], factors.shape[side]) for side in (0, 1))
    sized = [Image.fromarray(one).resize((width, height)) for one in (image, factors)]
    colours, part = (np.array(one) for one in sized)
    opacity, colours = colours[..., 3:], colours[..., :3]
    scale = 1.0 + float(np.clip(strength, 0.0, 1.0)) * (np.arange(256) / 255.0 - 1.0)
    linear = linear_from_srgb(np.arange(256) / 255.0)[colours] * scale[part][..., None]
    encoded = np.rint(255.0 * srgb_from_linear(linear)).astype(np.uint8)
    return np.concatenate((encoded, opacity), axis=-1)


def add_opacity(image: Texture | None, opacity: npt.NDArray[np.uint8]) -> Texture:
    """(h, w, 4) texture of an image, or of white, and a (h2, w2) opacity, 255 = opaque.

    The smaller one is enlarged.
    """
    from PIL import Image

    image = np.full((1, 1, 3), 255, dtype=np.uint8) if image is None else image
    height, width = (max(image.shape[side], opacity.shape[side]) for side in (0, 1))
    sized = [Image.fromarray(one).resize((width, height)) for one in (image, opacity)]
    colours, part = (np.array(one) for one in sized)
    return np.concatenate((colours, part[..., None]), axis=-1)
