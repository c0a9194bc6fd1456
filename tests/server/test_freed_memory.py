"""Freed memory between memory in use goes back to the system."""

from __future__ import annotations

import os
import platform

import numpy as np
import pytest

from catoptra_server.runtime.memory import release_freed_memory
from helpers.memory import resident_mb

BLOCK_BYTES = 100_000  # below the least size that glibc asks the system for
NUM_BLOCKS = 400


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="glibc alone has malloc_trim")
def test_gaps_between_blocks_in_use_are_given_back() -> None:
    blocks = [np.ones(BLOCK_BYTES, dtype=np.uint8) for _ in range(NUM_BLOCKS)]
    kept = blocks[::2]
    del blocks
    before_mb = resident_mb(os.getpid())
    release_freed_memory()
    # 20 MB are free; half of it, since blocks share their first and last pages with neighbours.
    assert resident_mb(os.getpid()) < before_mb - 10.0
    assert all(block[0] == 1 for block in kept)
