"""Random numbers that depend on (seed, names, index) alone: counter-based, a stream a source.

Philox (Salmon et al. 2011) is keyed by a hash of the seed and of what the numbers are for; the
index of a tick or a frame is its counter. So no thread, client or other robot can change what a
source draws.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class RandomSource:
    """The random numbers of one source, such as ("Run3", "Odometry")."""

    key: tuple[int, int]

    @classmethod
    def from_names(cls, seed: int, *names: str) -> RandomSource:
        """Return the stream of a source; other names or another seed give an independent one."""
        digest = hashlib.sha256("\0".join((str(seed), *names)).encode()).digest()
        return cls((int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:16], "little")))

    def generator(self, index: int) -> np.random.Generator:
        """Return a generator for one index (a tick, a frame): the same one each time."""
        key = np.array(self.key, dtype=np.uint64)
        return np.random.Generator(np.random.Philox(key=key, counter=[0, 0, 0, index]))
