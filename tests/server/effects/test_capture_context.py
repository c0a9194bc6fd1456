from __future__ import annotations

from catoptra_server.effects.effect import EMPTY_CONTEXT
from catoptra_server.world.camera_state import ZERO_SEED


def test_capture_when_nothing_is_known_has_no_ranges() -> None:
    assert EMPTY_CONTEXT.noise_seed == ZERO_SEED
    assert EMPTY_CONTEXT.range_m is None
