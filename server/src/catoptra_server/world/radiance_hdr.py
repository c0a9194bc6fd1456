"""Panoramas from Radiance HDR files: linear light by longitude and latitude.

The top row is up, the middle column is straight ahead (x), columns to its right are to the right
(y). A value of 1 is white. Source: Ward 1991, "Real Pixels"; colours as Radiance's own reader has
them, without the half of a step that `ra_xyze` adds. Of older files' repeated pixels none is read.
"""

from __future__ import annotations

import hashlib
import math
import re
from pathlib import Path

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import arctan2, hypot
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.runtime.array_cache import ArrayCache, find_cache_folder
from catoptra_server.world.panorama import (
    Panorama,
    make_panorama,
    restore_panorama,
    texel_directions,
)

_Pixels = npt.NDArray[np.uint8]

_MAX_PIXELS, _MAX_HEADER = 2**25, 2**16
_SIZES = (64, 2048)
_HEADER = re.compile(rb"#\?(?:RADIANCE|RGBE)\n((?:[^\n]*\n)*?)\n-Y (\d{1,9}) \+X (\d{1,9})\n")


def load_panorama(path: Path) -> Panorama:
    """Panorama of a Radiance HDR file.

    Raises:
        DomainError: The file is no such file, damaged or too large; the text says why.
        OSError: It cannot be read.
    """
    with path.open("rb") as opened:
        content = opened.read(4 * _MAX_PIXELS + _MAX_HEADER + 1)
    cache, key = ArrayCache(find_cache_folder("skies")), hashlib.sha256(content).hexdigest()
    found = restore_panorama(cache, key, 2)
    if found is not None:
        return found[0]
    panorama = _project(*_decode(content))
    cache.write(key, (panorama.texels, panorama.bounds))
    return panorama


def _decode(content: bytes) -> tuple[_Pixels, float]:
    """(h, w, 4) mantissas and exponents of a file, and its exposure."""
    header = _HEADER.match(content[:_MAX_HEADER])
    if header is None:
        raise DomainError("no Radiance HDR file of rows from the top, columns from the left")
    if b"FORMAT=32-bit_rle_rgbe" not in header[1].split(b"\n"):
        raise DomainError("its FORMAT is not 32-bit_rle_rgbe")
    exposures = re.findall(
        rb"EXPOSURE= *(\d{1,9}(?:\.\d{0,9})?(?:[eE][+-]?\d{1,2})?) *\n", header[1]
    )
    exposure = math.prod(map(float, exposures))
    height, width = int(header[2]), int(header[3])
    if not (0 < height * width <= _MAX_PIXELS and math.isfinite(exposure) and exposure > 0.0):
        raise DomainError(f"{width} x {height} px, of at most {_MAX_PIXELS} with an exposure")
    body = np.frombuffer(content, dtype=np.uint8, offset=header.end())
    if not 8 <= width < 2**15 or len(body) < 4 or body[0] != 2 or body[1] != 2 or body[2] > 127:
        if len(body) != 4 * height * width:
            raise DomainError("it is cut off, or of a form that is not read")
        return body.reshape(height, width, 4), exposure
    pixels = np.zeros((height, 4, width), dtype=np.uint8)
    at = 0
    for row in pixels:
        if bytes(body[at : at + 4]) != bytes((2, 2, width >> 8, width & 255)):
            raise DomainError("it is cut off, or damaged")
        at += 4
        for channel in row:
            at = _decode_runs(content, body, header.end(), at, channel)
    return pixels.transpose(0, 2, 1), exposure


def _decode_runs(content: bytes, body: _Pixels, start: int, at: int, channel: _Pixels) -> int:
    """Fill a channel of a row with runs and literal bytes; where the next one begins."""
    column, width = 0, len(channel)
    while column < width:
        count = content[start + at] if at + 1 < len(body) else 0
        is_run = count > 128
        count -= 128 if is_run else 0
        values = body[at + 1 : at + 2] if is_run else body[at + 1 : at + 1 + count]
        if not 0 < count <= width - column or (len(values) < count and not is_run):
            raise DomainError("it is cut off, or damaged")
        channel[column : column + count] = values
        column += count
        at += 2 if is_run else 1 + count
    return at


def _project(pixels: _Pixels, exposure: float) -> Panorama:
    """Panorama of (h, w, 4) pixels, bilinear."""
    height, width = pixels.shape[:2]
    size = min(max(width // 4 * 2, _SIZES[0]), _SIZES[1])
    directions = texel_directions(size).reshape(-1, 3)
    radiance = np.zeros((len(directions), 3))
    # In parts: of 4 million directions at once the arrays take a gigabyte.
    for begin in range(0, len(directions), 2**18):
        part = slice(begin, begin + 2**18)
        radiance[part] = _look_up(pixels, directions[part], width, height)
    return make_panorama(radiance.reshape(size, size, 3) / exposure)


def _look_up(pixels: _Pixels, directions: Floats, width: int, height: int) -> Floats:
    """(n, 3) light in (n, 3) directions."""
    x, y, z = directions.T
    column = (0.5 + arctan2(y, x) / (2.0 * math.pi)) * width - 0.5
    row = (0.5 + arctan2(z, hypot(x, y)) / math.pi) * height - 0.5
    left, top = np.floor(column).astype(np.intp), np.floor(row).astype(np.intp)
    fx, fy = (column - left)[:, None], (row - top)[:, None]
    rows = [np.clip(top + i, 0, height - 1) for i in range(2)]
    columns = [np.mod(left + i, width) for i in range(2)]
    (a, b), (c, d) = [[_light(pixels[k, i]) for i in columns] for k in rows]
    return np.asarray((1.0 - fy) * ((1.0 - fx) * a + fx * b) + fy * ((1.0 - fx) * c + fx * d))


def _light(pixels: _Pixels) -> Floats:
    """(n, 3) light of (n, 4) mantissas and exponents."""
    exponent = pixels[:, 3:].astype(np.int32) - 136
    return np.asarray(np.ldexp(np.float64(pixels[:, :3]) * (exponent > -136), exponent))
