"""What a frame's random numbers are keyed by."""

from __future__ import annotations

from dataclasses import dataclass

from catoptra_server.random_sources import RandomSource


@dataclass(frozen=True, slots=True)
class NoiseSeed:
    """A camera, by two 32-bit words, and an exposure of it.

    index: the robot's tick at the exposure, not a count of pictures, so that nobody who asks for
    one more picture changes the noise of others; an exposure asked for twice is the same.
    """

    camera_key: tuple[int, int] = (0, 0)
    tick: int = 0

    @classmethod
    def from_source(cls, source: RandomSource, tick: int) -> NoiseSeed:
        """Return the key of an exposure of the camera that a stream belongs to."""
        word = source.key[0]
        return cls((word & 0xFFFFFFFF, word >> 32), tick)


ZERO_SEED = NoiseSeed()
