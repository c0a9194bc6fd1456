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

import io
import warnings
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, cast

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.optics.elementary import einsum
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.runtime.memory import BYTES_PER_TEXEL, MemoryBudget
from catoptra_server.world.shading import sample_texture
from catoptra_server.world.triangles import select_rows
from catoptra_server.world.world_description import Rgb, linear_from_srgb, srgb_from_linear

# (h, w, 3) sRGB, row 0 at the top; or (h, w, 4) with opacity, 255 = opaque, for holes
Texture = npt.NDArray[np.uint8]

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
        _reserve_texels(image.size, memory or MemoryBudget(), where)
        return _decode_image(image, where)


def decode_texture(
    data: bytes, where: SourceLocation, memory: MemoryBudget, *, has_opacity: bool = False
) -> Texture:
    """(h, w, 3) uint8 sRGB of an image file's content, counted before it is decoded.

    (h, w, 4) with opacity, where that is wanted.

    Raises:
        ConfigError: The bytes are no readable image, or larger than the budget.
    """
    with _open_image(io.BytesIO(data), where) as image:
        _reserve_texels(image.size, memory, where)
        return _decode_image(image, where, has_opacity=has_opacity)


def _reserve_texels(size: tuple[int, int], memory: MemoryBudget, where: SourceLocation) -> None:
    """Count the memory of a texture of (width, height) texels."""
    width, height = size
    memory.reserve(
        BYTES_PER_TEXEL * width * height,
        where=where,
        key="Texture",
        value=f"{width} x {height} px",
        remedy="a smaller image",
    )


def _decode_image(image: Any, where: SourceLocation, *, has_opacity: bool = False) -> Texture:
    """(h, w, 3) uint8 sRGB of a Pillow image, or (h, w, 4) with its opacity, read-only."""
    if image.format is not None and image.format not in _FORMATS:
        raise _image_error(where, f"its format {image.format} is not read")
    try:
        if image.mode.startswith("I"):
            # Grey of 16 bits, of which Pillow's own conversion keeps the lower eight.
            grey = np.clip(np.rint(np.array(image) / 257.0), 0.0, 255.0).astype(np.uint8)
            texture = np.repeat(grey[..., None], 3, axis=-1)
        else:
            texture = np.array(image.convert("RGBA" if has_opacity else "RGB"))
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

Levels = tuple[npt.NDArray[np.float32], ...]
"""(h, w, 3) linear texels of the image, then of each coarser level, to one texel; (h, w, 4) with
opacity last."""


def build_levels(image: Texture) -> Levels:
    """All levels of an image; each side is half the one before, rounded down, as in OpenGL."""
    # Float32: in float64 a texture of 4096 px would take 400 MB.
    levels = [linear_from_srgb(np.arange(256) / 255.0).astype(np.float32)[image]]
    levels[0][..., 3:] = image[..., 3:] / np.float32(255.0)
    while max(levels[-1].shape[:2]) > 1:
        levels.append(_halve_rows(_halve_rows(levels[-1]).swapaxes(0, 1)).swapaxes(0, 1))
    return tuple(np.ascontiguousarray(level) for level in levels)


def _halve_rows(texels: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Half as many rows of the same height together: means by the covered parts."""
    count = len(texels)
    half = count // 2
    if half == 0:
        return texels
    if count % 2 == 0:
        return 0.5 * (texels[0::2] + texels[1::2])
    # Row k of n covers 2 + 1/n old rows, from k (2 + 1/n) on: a part of the first, the second,
    # a part of the third.
    row = np.arange(half, dtype=np.float32)[:, None, None]
    parts = (half - row) * texels[0:-2:2] + half * texels[1:-1:2] + (row + 1.0) * texels[2::2]
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
        # Float64 by its coordinates, whatever the texels are.
        is_image = (weight[rays, 0] == 0.0) & (number == 0)
        one, other = (
            sample_texture(
                cast(Floats, each),
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
