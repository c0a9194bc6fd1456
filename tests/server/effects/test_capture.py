from __future__ import annotations

from catoptra_server.effects.capture import NOTHING_KNOWN
from catoptra_server.effects.frame_key import UNKEYED


def test_capture_when_nothing_is_known_has_no_ranges() -> None:
    assert NOTHING_KNOWN.key == UNKEYED
    assert NOTHING_KNOWN.range_m is None
