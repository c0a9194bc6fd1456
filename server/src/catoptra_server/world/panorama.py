"""What rays show that meet no surface, by direction: a map of linear radiance.

The map is octahedral: a direction's place is that of its point on |x| + |y| + |z| = 1, seen from
above, the lower half mirrored outwards; up is in the middle, straight down at the corners. Texels
are 32 bits: mantissas of 9 bits of R, G and B, and an exponent of 5 bits, biased by 15. They are
interpolated bilinearly; a border of one texel repeats what lies beyond each edge. Twins:
render/trace/kernel/src/sky.c and glsl/sky.frag. A square of 1024 texels is 4 MB and 0.2 degrees
fine; one of float32 is 12 MB, and one of latitudes takes two functions of angle per ray.

A Radiance HDR file is linear light by longitude and latitude: the top row is up, the middle column
is straight ahead (x), columns to its right are to the right (y). It is read here, since OpenCV's
reader copies it to a temporary file, takes three times the memory and writes to stderr. Of older
files' repeated pixels none is read.
Source: Engelhardt & Dachsbacher 2008, "Octahedron Environment Maps"; the packing is that of
OpenGL's EXT_texture_shared_exponent. Ward 1991, "Real Pixels"; colours as Radiance's own reader has
them, without the half of a step that `ra_xyze` adds.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import arctan2, hypot, power
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.runtime.array_cache import ArrayCache, find_cache_folder
from catoptra_server.world.world_description import Rgb

Texels = npt.NDArray[np.uint32]
_Indices = npt.NDArray[np.intp]

_MANTISSA_BITS, _EXPONENT_SHIFT, _BIAS, _MAX_EXPONENT = 9, 27, 24, 31
_MAX_MANTISSA = 2**_MANTISSA_BITS - 1
MAX_RADIANCE = float(_MAX_MANTISSA * 2 ** (_MAX_EXPONENT - _BIAS))
"""Largest radiance of a texel; what is brighter has this one."""
_MAX_PIXELS, _MAX_HEADER = 2**25, 2**16
_SIZES = (64, 2048)
_HEADER = re.compile(rb"#\?(?:RADIANCE|RGBE)\n((?:[^\n]*\n)*?)\n-Y (\d{1,9}) \+X (\d{1,9})\n")
_EXPOSURE = re.compile(rb"EXPOSURE= *(\d{1,9}(?:\.\d{0,9})?(?:[eE][+-]?\d{1,2})?) *\n")


@dataclass(frozen=True, slots=True, eq=False)
class Panorama:
    """Radiance by direction, world frame."""

    texels: Texels
    """(size + 2, size + 2) texels with the border; read-only."""
    least: Rgb
    """Smallest radiance of each colour in any direction."""
    largest: Rgb
    """Largest radiance likewise."""
    mean: Rgb
    """Mean over all directions."""

    @property
    def size(self) -> int:
        """Texels along a side, without the border."""
        return len(self.texels) - 2

    def decode(self) -> Floats:
        """(size + 2, size + 2, 3) radiance of all texels."""
        return _decode(self.texels)

    def radiance(self, directions: Floats) -> Floats:
        """(n, 3) linear radiance of (n, 3) directions of any length, world frame."""
        x, y, z = (directions / np.abs(directions).sum(axis=-1, keepdims=True)).T
        outer_x = np.where(x < 0.0, -1.0, 1.0) * (1.0 - np.abs(y))
        outer_y = np.where(y < 0.0, -1.0, 1.0) * (1.0 - np.abs(x))
        below = z > 0.0
        places = np.stack((np.where(below, outer_x, x), np.where(below, outer_y, y)))
        column, row = 0.5 * self.size * places + (0.5 * self.size + 0.5)
        return interpolate(lambda rows, columns: _decode(self.texels[rows, columns]), row, column)


def interpolate(
    read: Callable[[_Indices, _Indices], Floats], rows: Floats, columns: Floats
) -> Floats:
    """(n, k) bilinear values at (n,) rows and columns between those that `read` has at integers."""
    top, left = np.floor(rows).astype(np.intp), np.floor(columns).astype(np.intp)
    fy, fx = (rows - top)[:, None], (columns - left)[:, None]
    a, b, c, d = (read(top + i, left + j) for i in range(2) for j in range(2))
    return np.asarray((1.0 - fy) * ((1.0 - fx) * a + fx * b) + fy * ((1.0 - fx) * c + fx * d))


def texel_directions(size: int) -> Floats:
    """(size, size, 3) directions of the texels of a map on |x| + |y| + |z| = 1, world frame."""
    steps = (np.arange(size) + 0.5) * (2.0 / size) - 1.0
    u, v = steps[None, :], steps[:, None]
    z = np.abs(u) + np.abs(v) - 1.0
    x = np.where(z > 0.0, np.copysign(1.0 - np.abs(v), u), u)
    y = np.where(z > 0.0, np.copysign(1.0 - np.abs(u), v), v)
    return np.stack((x, y, z), axis=-1)


def solid_angles(size: int) -> Floats:
    """(size, size) solid angles of the texels of a map; their sum is exactly that of a sphere."""
    # Texels have equal areas on the octahedron, whose faces all have the same distance.
    weights = power(np.square(texel_directions(size)).sum(axis=-1), -1.5)
    return np.asarray(weights * (4.0 * math.pi / weights.sum()))


def make_panorama(radiance: Floats) -> Panorama:
    """Panorama of (size, size, 3) radiance in the directions of `texel_directions`."""
    texels = np.pad(_encode(radiance), 1)
    # Beyond an edge is the mirror image of the texels inside it.
    texels[0, :], texels[-1, :] = texels[1, ::-1], texels[-2, ::-1]
    texels[:, 0], texels[:, -1] = texels[::-1, 1], texels[::-1, -2]
    texels.setflags(write=False)
    kept, weights = _decode(texels[1:-1, 1:-1]), solid_angles(len(radiance)) / (4.0 * math.pi)
    mean = (weights[..., None] * kept).sum(axis=(0, 1))
    return _hold(texels, np.stack((kept.min(axis=(0, 1)), kept.max(axis=(0, 1)), mean)))


def _hold(texels: Texels, bounds: Floats) -> Panorama:
    """Panorama with its (3, 3) least, largest and mean radiance."""
    return Panorama(texels, *(cast("Rgb", tuple(row)) for row in bounds.tolist()))


def find_panorama(
    key: str, lights: int, compute: Callable[[], tuple[Panorama, Floats]]
) -> tuple[Panorama, Floats]:
    """Panorama of a key with (lights, 3) numbers, from the cache of this user or computed now."""
    cache = ArrayCache(find_cache_folder("skies"))
    texels, numbers = cache.read(key, 2) or (np.zeros(0, np.uint32), np.zeros(0))
    # The kernel checks no place in the map again.
    if (
        texels.dtype == np.uint32
        and texels.ndim == 2
        and texels.shape[0] == texels.shape[1] > 2
        and numbers.shape == (3 + lights, 3)
        and np.isfinite(numbers).all()
    ):
        return _hold(texels, numbers[:3]), numbers[3:]
    panorama, light = compute()
    bounds = np.array((panorama.least, panorama.largest, panorama.mean))
    cache.write(key, (panorama.texels, np.concatenate((bounds, light))))
    return panorama, light


def _encode(radiance: Floats) -> Texels:
    """(...) texels of (..., 3) radiance, rounded to the nearest."""
    clipped = np.clip(radiance, 0.0, MAX_RADIANCE)
    exponent = np.maximum(np.frexp(clipped.max(axis=-1))[1] + _BIAS - _MANTISSA_BITS, 0)
    # Rounding may reach the next power of two.
    exponent += _round_mantissas(clipped, exponent).max(axis=-1) > _MAX_MANTISSA
    r, g, b = np.moveaxis(_round_mantissas(clipped, exponent), -1, 0).astype(np.uint32)
    packed = r | g << _MANTISSA_BITS | b << 2 * _MANTISSA_BITS
    return np.asarray(packed | exponent.astype(np.uint32) << _EXPONENT_SHIFT)


def _round_mantissas(radiance: Floats, exponent: npt.NDArray[np.integer]) -> Floats:
    return np.asarray(np.floor(np.ldexp(radiance, (_BIAS - exponent)[..., None]) + 0.5))


def _decode(texels: Texels) -> Floats:
    """(..., 3) radiance of (...) texels."""
    shifts = np.arange(3, dtype=np.uint32) * np.uint32(_MANTISSA_BITS)
    mantissas = texels[..., None] >> shifts & np.uint32(_MAX_MANTISSA)
    exponent = (texels >> np.uint32(_EXPONENT_SHIFT)).astype(np.int32) - _BIAS
    return np.asarray(np.ldexp(mantissas.astype(np.float64), exponent[..., None]))


def load_panorama(path: Path) -> Panorama:
    """Panorama of a Radiance HDR file.

    Raises:
        DomainError: The file is no such file, damaged or too large; the text says why.
        OSError: It cannot be read.
    """
    with path.open("rb") as opened:
        content = opened.read(4 * _MAX_PIXELS + _MAX_HEADER + 1)
    key = hashlib.sha256(content).hexdigest()
    return find_panorama(key, 0, lambda: (_read_hdr(content), np.zeros((0, 3))))[0]


def _read_hdr(content: bytes) -> Panorama:
    header = _HEADER.match(content[:_MAX_HEADER])
    if header is None or b"FORMAT=32-bit_rle_rgbe" not in header[1].split(b"\n"):
        raise DomainError("no Radiance HDR file (32-bit_rle_rgbe) of rows from the top")
    height, width = int(header[2]), int(header[3])
    exposure = math.prod(map(float, _EXPOSURE.findall(header[1])))
    if not (0 < height * width <= _MAX_PIXELS and 0.0 < exposure < math.inf):
        raise DomainError(f"{width} x {height} px, of at most {_MAX_PIXELS} with an exposure")
    body = memoryview(content)[header.end() :]
    try:
        pixels = _unpack_rows(body, height, width)
    except (IndexError, ValueError) as error:
        raise DomainError("it is cut off, damaged, or of a form that is not read") from error
    size = min(max(width // 4 * 2, _SIZES[0]), _SIZES[1])
    # In parts: of 4 million directions at once the arrays take a gigabyte.
    parts = np.array_split(texel_directions(size).reshape(-1, 3), max(size**2 >> 18, 1))
    radiance = np.concatenate([_look_up(pixels, part) for part in parts])
    return make_panorama(radiance.reshape(size, size, 3) / exposure)


def _unpack_rows(body: memoryview, height: int, width: int) -> npt.NDArray[np.uint8]:
    """(h, w, 4) mantissas and exponents of rows: plain, or channel after channel in runs.

    Raises:
        IndexError, ValueError: The rows have another length, or another form.
    """
    begin = bytes((2, 2, width >> 8 & 127, width & 255))
    if body[:4] != begin:
        return np.frombuffer(body, np.uint8).reshape(height, width, 4)
    pixels, at = bytearray(), 0
    for row in range(1, height + 1):
        if body[at : at + 4] != begin:
            raise ValueError("a row has no beginning")
        at += 4
        while len(pixels) < 4 * width * row:
            count = body[at]
            is_run = count > 128
            pixels += bytes((body[at + 1],)) * (count - 128) if is_run else body[at + 1 :][:count]
            at += 2 if is_run else 1 + count
    return np.frombuffer(pixels, np.uint8).reshape(height, 4, width).transpose(0, 2, 1)


def _look_up(pixels: npt.NDArray[np.uint8], directions: Floats) -> Floats:
    """(n, 3) light in (n, 3) directions, of (h, w, 4) mantissas and exponents."""
    height, width = pixels.shape[:2]

    def read(rows: _Indices, columns: _Indices) -> Floats:
        texels = pixels[np.clip(rows, 0, height - 1), np.mod(columns, width)]
        exponent = texels[:, 3:].astype(np.int32) - 136
        return np.asarray(np.ldexp(np.float64(texels[:, :3]) * (exponent > -136), exponent))

    x, y, z = directions.T
    columns = (0.5 + arctan2(y, x) / (2.0 * math.pi)) * width - 0.5
    rows = (0.5 + arctan2(z, hypot(x, y)) / math.pi) * height - 0.5
    return interpolate(read, rows, columns)
