from __future__ import annotations

from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.world.camera_state import NoiseSeed


def test_seed_of_a_source_has_two_words_of_32_bits() -> None:
    key = NoiseSeed.from_source(RandomSource((0x1122334455667788, 9)), 5)
    assert key == NoiseSeed((0x55667788, 0x11223344), 5)


def test_seed_differs_between_cameras() -> None:
    keys = {
        NoiseSeed.from_source(RandomSource.from_names(1, "Mine", name), 0)
        for name in ("Left", "Right")
    }
    assert len(keys) == 2
