"""Resources that a server's process may take: memory, descriptors, processors.

Files and options can ask for more than a machine has: a PNG of 22 kB has 13 300 px a side, a camera
of 16 x 16 samples a pixel needs 256 rays for each. Sizes are estimated from such numbers alone and
compared with a limit before memory is taken. The estimates are peaks of the resident size, start
included, in tests/measurements/memory_per_item.py.

Freed memory goes back to the system. The C library keeps some for later allocations: up to 64 MiB
at the end of each of its heaps, and all gaps between what is still in use. Seven views of 193 MB in
all, as clients get them by trying accuracies, left 62 MB of gaps; closing the gaps takes 0.4 to 9
ms a view. To return each large array at once (M_MMAP_THRESHOLD, 4 MiB) saves as much and costs a
frame with all effects 24 ms.

Every connection takes at least one descriptor, so the limit of open files is raised at the start.
"""

from __future__ import annotations

import ctypes
import math
import os
import resource
from collections.abc import Callable
from functools import cache
from typing import Generic, TypeVar

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.slotted_dataclass import dataclass

MIB = 2**20
# A camera of 2048 px at 2 x 2 samples, or a world of 1.3 million triangles, fits.
DEFAULT_LIMIT_BYTES = 1024 * MIB
# A tebibyte: a larger number is taken for bytes.
MAX_LIMIT_MIB = 2**20

# A triangle in NumPy arrays and in the structures of raster: 540 to 610, of trace 370. Colours at
# its corners add 80, texture coordinates 60, emission 130 and gloss 20 (in trace 20 each): all at
# once, 100 more than this, are those of no file that has been seen.
BYTES_PER_TRIANGLE = 750
# Held: three bytes, which both renderers share; trace adds two of coarser levels, and six of light
# but in large scenes; raster four on the device with a third more for coarser levels.
# For one texture at a time: Pillow's pixels, then float32s.
BYTES_PER_TEXEL = 11
LARGE_SCENE_BYTES_PER_TEXEL = 9
# Above this, images of a scene stay bytes where trace looks texels up; a frame of a textured floor
# takes an eighth longer. As light, sixteen of 1024 px take 48 MiB more, and a house's 87 more than
# the default limit leaves beside its triangles.
MAX_LIGHT_TEXELS = 16 * 2**20
PEAK_BYTES_PER_TEXEL = 24

# Rays of a sample in two orders, 12 bytes each, and the batch in which these are computed.
_TRACE_BYTES_PER_SAMPLE = 26
# Of a mirror without a viewpoint a ray has an origin, too: 39 bytes a sample instead of 19.
_ORIGIN_BYTES_PER_SAMPLE = 20
_TRACE_BYTES_PER_PX = 40
_TRACE_BYTES = 64 * MIB
# Lookup map of a sample: 8 bytes on the device, as many on the way there.
_RASTER_BYTES_PER_SAMPLE = 18
_RASTER_BYTES_PER_PX = 20
_RASTER_BYTES = 48 * MIB
# Linear light and depth, of each sample of a texel, and of the texel after they are averaged.
_RASTER_BYTES_PER_TEXEL = 12


@dataclass(frozen=True, slots=True)
class ViewSize:
    """Numbers that determine the memory of one camera's view."""

    num_pixels: int
    samples_per_pixel: int
    num_texels: int = 0
    """Texels of all faces in the raster renderer."""
    samples_per_texel: int = 1
    effect_bytes_per_px: int = 0
    """Memory of the effects that may change the image."""
    has_origins: bool = False
    """Whether each ray has an origin of its own."""

    @property
    def num_bytes(self) -> int:
        """Bytes with the renderer that takes more, since either may be chosen."""
        samples = self.num_pixels * self.samples_per_pixel
        origins = _ORIGIN_BYTES_PER_SAMPLE if self.has_origins else 0
        trace = _TRACE_BYTES + (_TRACE_BYTES_PER_SAMPLE + origins) * samples
        trace += _TRACE_BYTES_PER_PX * self.num_pixels
        raster = _RASTER_BYTES + _RASTER_BYTES_PER_SAMPLE * samples
        raster += _RASTER_BYTES_PER_PX * self.num_pixels
        raster += _RASTER_BYTES_PER_TEXEL * self.num_texels * (1 + self.samples_per_texel)
        return max(trace, raster) + self.effect_bytes_per_px * self.num_pixels


class MemoryBudget:
    """Memory of one camera's view, or of one world's triangles and textures together."""

    def __init__(self, limit_bytes: int = DEFAULT_LIMIT_BYTES) -> None:
        self._limit_bytes = limit_bytes
        self._reserved_bytes = 0

    def for_reading(self) -> MemoryBudget:
        """Budget of the same limit, for memory that is free again once a file is read."""
        return MemoryBudget(self._limit_bytes)

    def reserve(
        self, num_bytes: int, *, where: SourceLocation, key: str, value: str, remedy: str
    ) -> None:
        """Count memory that is about to be taken.

        Args:
            num_bytes: the estimate.
            where: file and line of the number that the estimate follows from.
            key: the number's key.
            value: the number.
            remedy: acceptable value, as a phrase, such as `a smaller texture`.

        Raises:
            ConfigError: if the limit is exceeded.
        """
        self._reserved_bytes += num_bytes
        if self._reserved_bytes > self._limit_bytes:
            total = _format_mib(self._reserved_bytes)
            limit = _format_mib(self._limit_bytes)
            expected = (
                f"{remedy}: this would take {total} MiB of memory, more than the limit of {limit} "
                "(--memory-limit-mib)"
            )
            raise ConfigError(where, key=key, value=value, expected=expected)


def _format_mib(num_bytes: int) -> str:
    return str(math.ceil(num_bytes / MIB))


_K = TypeVar("_K")
_V = TypeVar("_V")


class LruDict(Generic[_K, _V]):
    """Items by key, each made at its first use; no item is None."""

    def __init__(
        self, max_items: int, *, on_remove: Callable[[_K], object] = lambda key: None
    ) -> None:
        """Create an empty dictionary.

        Args:
            max_items: Number of items above which the one used longest ago is removed.
            on_remove: Receives the key of each item that is removed.
        """
        self._max_items = max_items
        self._on_remove = on_remove
        self._items: dict[_K, _V] = {}  # the last used at the end

    def __len__(self) -> int:
        """Number of items."""
        return len(self._items)

    def get(self, key: _K) -> _V | None:
        """Item of a key, which does not count as a use."""
        return self._items.get(key)

    def get_or_make(self, key: _K, make: Callable[[], _V]) -> _V:
        """Item of a key, made by a function if there is none."""
        # Removed and inserted again: dicts keep the order of insertion.
        item = self._items.pop(key, None)
        if item is None:
            item = make()
        self._items[key] = item
        while len(self._items) > self._max_items:
            self.remove(next(iter(self._items)))
        return item

    def put(self, key: _K, item: _V) -> None:
        """Set the item of a key, in place of another one; `on_remove` is not called for that."""
        self._items.pop(key, None)
        self.get_or_make(key, lambda: item)

    def remove(self, key: _K) -> None:
        """Remove the item of a key."""
        del self._items[key]
        self._on_remove(key)

    def clear(self) -> None:
        """Remove all items."""
        for key in self.keys():
            self.remove(key)

    def keys(self) -> tuple[_K, ...]:
        """Keys, the one used longest ago first."""
        return tuple(self._items)


def release_freed_memory() -> None:
    """Give the pages of freed memory back; without effect where the C library is not glibc."""
    _find_malloc_trim()(0)


@cache
def _find_malloc_trim() -> Callable[[int], object]:
    """The function of glibc that trims all heaps, keeping some bytes at the end of the first."""
    return getattr(ctypes.CDLL(None), "malloc_trim", lambda _: 0)


# Limits of a million, as some containers set, suggest tables of that size to libraries.
_MAX_DESCRIPTORS = 65_536


def raise_descriptor_limit() -> int:
    """Raise the soft limit of open files to the hard limit, or to _MAX_DESCRIPTORS.

    Returns:
        The soft limit now.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = _MAX_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, _MAX_DESCRIPTORS)
    if soft == resource.RLIM_INFINITY or soft >= wanted:
        return soft
    resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    return wanted


def count_processors() -> int:
    """Processors of the affinity mask, or of the machine where the system has no such mask.

    The mask, since containers and tests restrict a process to fewer processors than there are.
    """
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
