"""Random numbers that depend on (seed, names, index) alone: a counter-based generator per source.

Philox (Salmon et al. 2011) is keyed by a hash of the seed and the names of the source, such as
("Run3", "Odometry"); the index of a tick or a frame is the counter. No thread, client or other
robot changes the numbers of a source.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class RandomSource:
    """Random numbers of one source, such as ("Run3", "Odometry")."""

    key: tuple[int, int]
    """The 128 bits of Philox's key."""

    @classmethod
    def from_names(cls, seed: int, *names: str) -> RandomSource:
        """Source by its names; other names or another seed give independent numbers."""
        # Joined by NUL, which no name contains: ("ab", "c") and ("a", "bc") differ. SHA-256 and not
        # hash(), which Python salts in each process.
        digest = hashlib.sha256("\0".join((str(seed), *names)).encode()).digest()
        return cls((int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:16], "little")))

    def generator(self, index: int) -> np.random.Generator:
        """Generator for one index (a tick, a frame), in the same state at each call."""
        # The index is the counter's highest word: 2^192 numbers until the next index's begin.
        key = np.array(self.key, dtype=np.uint64)
        return np.random.Generator(np.random.Philox(key=key, counter=[0, 0, 0, index]))
