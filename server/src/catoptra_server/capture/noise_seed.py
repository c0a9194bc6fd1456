"""Seed of the image noise of one exposure."""

from __future__ import annotations

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.random_sources import RandomSource


@dataclass(frozen=True, slots=True)
class NoiseSeed:
    """Key of a camera and of an exposure, for counter-based random numbers."""

    camera_key: tuple[int, int] = (0, 0)
    """Two 32-bit words that identify the camera."""
    # Not a count of frames: a further request then changes nobody's noise, and two channels that
    # show one exposure have the same noise.
    tick: int = 0
    """Tick of the robot at the exposure."""

    @classmethod
    def from_source(cls, source: RandomSource, tick: int) -> NoiseSeed:
        """Seed of the exposure at a tick, of the camera that a random source belongs to."""
        word = source.key[0]
        return cls((word & 0xFFFFFFFF, word >> 32), tick)


ZERO_SEED = NoiseSeed()
