"""Memory that was freed, given back to the system.

The C library keeps what is freed for later allocations: up to 64 MiB at the end of each of its
heaps, and all gaps between what is still in use. Preparing a view leaves such gaps, as large as the
view itself.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache


def release_freed_memory() -> None:
    """Give the pages of freed memory back; without effect where the C library is not glibc."""
    _find_malloc_trim()(0)


@cache
def _find_malloc_trim() -> Callable[[int], object]:
    """The function of glibc that trims all heaps, keeping some bytes at the end of the first."""
    return getattr(ctypes.CDLL(None), "malloc_trim", lambda _: 0)
