"""Random numbers that depend on (seed, names, index) alone: a counter-based generator per source.

Philox (Salmon et al. 2011) is keyed by a hash of the seed and the names of the source, such as
("Run3", "Odometry"); the index of a tick or a frame is the counter. No thread, client or other
robot changes the numbers of a source: a robot's noise follows from seed and robot name, never from
the order of connections. The experiment's runs are the robots `Run0`, `Run1` and so on.
"""

from __future__ import annotations

import hashlib
import math
from functools import cache
from typing import cast

import numpy as np
from numpy.typing import DTypeLike

from catoptra_protocol.optics.elementary import cos, ln
from catoptra_protocol.slotted_dataclass import dataclass


@cache
def _make_zero_entropy() -> np.random.SeedSequence:
    """Seed of a generator whose state is set afterwards.

    Without a seed NumPy would fetch one from the operating system: 21 instead of 6 microseconds a
    generator, of which each moving robot needs some in every tick.
    """
    # Loaded with the first generator: no frame of a robot that stands needs one.
    from numpy.random.bit_generator import ISeedSequence

    class ZeroSeed(ISeedSequence):
        def generate_state(self, n_words: int, dtype: DTypeLike = np.uint32) -> np.ndarray:
            return np.zeros(n_words, dtype)

    # The stubs know NumPy's own seeds only; the documentation has any with the interface.
    return cast(np.random.SeedSequence, ZeroSeed())


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
        philox = np.random.Philox(_make_zero_entropy())
        # The index is the counter's highest word: 2^192 numbers until the next index's begin.
        philox.state = {
            "bit_generator": "Philox",
            "state": {
                "counter": np.array((0, 0, 0, index), dtype=np.uint64),
                "key": np.array(self.key, dtype=np.uint64),
            },
            # Empty: the first number computes a new block.
            "buffer": np.zeros(4, dtype=np.uint64),
            "buffer_pos": 4,
            "has_uint32": 0,
            "uinteger": 0,
        }
        return np.random.Generator(philox)

    def normal_variates(self, index: int, count: int) -> list[float]:
        """Normal variates of one index, by Box and Muller; NumPy's need the C library's functions.

        Plain floats: most sensors have two or three.
        """
        uniform = self.generator(index).random(2 * count).tolist()
        return [
            math.sqrt(-2.0 * ln(1.0 - first)) * cos(2.0 * math.pi * second)
            for first, second in zip(uniform[::2], uniform[1::2], strict=True)
        ]
