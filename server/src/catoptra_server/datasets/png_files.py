"""PNG files whose bytes depend on the pixels and on zlib's version alone.

OpenCV's encoder may write other bytes on another processor; the standard library's zlib does not.
Source: PNG specification, third edition (W3C 2025), 7.2 and 9.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError

ENCODER = f"zlib {zlib.ZLIB_RUNTIME_VERSION}"
"""Library on which the bytes depend, and the version."""

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_LEVEL = 1
_COLOUR_TYPES = {1: 0, 3: 2}  # grey, RGB
_FILTER_NONE, _FILTER_SUB, _FILTER_UP = 0, 1, 2
_HEURISTIC_STEP = 5


def encode_png(image: npt.NDArray[Any]) -> bytes:
    """PNG file of (h, w) uint8 or uint16, or of (h, w, 3) uint8.

    Raises:
        DomainError: Another shape or type.
    """
    depth = 1 if image.ndim == 2 else image.shape[-1]
    if image.dtype not in (np.uint8, np.uint16) or depth not in _COLOUR_TYPES or not image.size:
        raise DomainError(f"no PNG file of {image.dtype} {image.shape}")
    height, width = image.shape[:2]
    bits = 8 * image.dtype.itemsize
    header = struct.pack(">IIBBBBB", width, height, bits, _COLOUR_TYPES[depth], 0, 0, 0)
    big_endian = np.ascontiguousarray(image, dtype=image.dtype.newbyteorder(">"))
    rows = big_endian.view(np.uint8).reshape(height, -1)
    filtered = _filter_rows(rows, depth * image.dtype.itemsize)
    body = zlib.compress(filtered.tobytes(), _LEVEL)
    return _SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", body) + _chunk(b"IEND", b"")


def _chunk(kind: bytes, content: bytes) -> bytes:
    checksum = zlib.crc32(kind + content)
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checksum)


def _filter_rows(rows: npt.NDArray[np.uint8], pixel_bytes: int) -> npt.NDArray[np.uint8]:
    """(h, 1 + n) rows, each by the best filter, whose number comes first."""
    # Differences modulo 256 from the pixel on the left, and from the row above; 0 outside.
    left, above = rows.copy(), rows.copy()
    left[:, pixel_bytes:] -= rows[:, :-pixel_bytes]
    above[1:] -= rows[:-1]
    candidates = rows, left, above
    # The specification's heuristic, smallest sum of magnitudes as signed bytes, of every fifth
    # byte: all bytes and channels of pixels take turns.
    some = np.stack([one[:, ::_HEURISTIC_STEP] for one in candidates])
    best = np.minimum(some, -some).sum(axis=-1, dtype=np.int64).argmin(axis=0)
    filtered = np.zeros((len(rows), 1 + rows.shape[1]), dtype=np.uint8)
    filtered[:, 0] = np.array((_FILTER_NONE, _FILTER_SUB, _FILTER_UP))[best]
    for number, one in enumerate(candidates):
        filtered[best == number, 1:] = one[best == number]
    return filtered


def decode_png(content: bytes) -> npt.NDArray[Any]:
    """Image of a file that `encode_png` has written, checksums compared.

    Raises:
        DomainError: The file is damaged, or of another writer's kind.
    """
    try:
        chunks = dict(_read_chunks(content))
        width, height, bits, colour, *_ = struct.unpack(">IIBBBBB", chunks[b"IHDR"])
        rows = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8)
        depth = {kind: count for count, kind in _COLOUR_TYPES.items()}[colour]
        rows = _unfilter(rows.reshape(height, -1), depth * bits // 8)
        image = rows.view(np.dtype(f">u{bits // 8}")).reshape(height, width, depth)
    except (struct.error, zlib.error, KeyError, ValueError, TypeError) as error:
        raise DomainError(f"no PNG file of this program: {error}") from error
    return image.astype(image.dtype.newbyteorder("="))[..., 0 if depth == 1 else slice(None)]


def _read_chunks(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    if not content.startswith(_SIGNATURE):
        raise ValueError("its signature is missing")
    place = len(_SIGNATURE)
    while place < len(content):
        (length,) = struct.unpack_from(">I", content, place)
        kind, body = content[place + 4 : place + 8], content[place + 8 : place + 8 + length]
        (checksum,) = struct.unpack_from(">I", content, place + 8 + length)
        if zlib.crc32(kind + body) != checksum:
            raise ValueError("a checksum differs")
        yield kind, body
        place += 12 + length


def _unfilter(rows: npt.NDArray[np.uint8], pixel_bytes: int) -> npt.NDArray[np.uint8]:
    """(h, n) rows from (h, 1 + n) filtered ones."""
    numbers, filtered = rows[:, 0], rows[:, 1:]
    if numbers.max(initial=0) > _FILTER_UP:
        raise ValueError("a filter that is not written here")
    image = np.array(filtered)
    left = numbers == _FILTER_SUB
    pixels = filtered[left].reshape(int(left.sum()), filtered.shape[1] // pixel_bytes, pixel_bytes)
    image[left] = np.cumsum(pixels, axis=1, dtype=np.uint8).reshape(-1, filtered.shape[1])
    for row in np.flatnonzero(numbers == _FILTER_UP):
        if row:
            image[row] += image[row - 1]
    return image
