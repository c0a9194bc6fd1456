from __future__ import annotations

from catoptra_server.effects.capture import NOTHING_KNOWN
from catoptra_server.effects.frame_key import UNKEYED
from catoptra_server.scene.motion import AT_REST


def test_capture_when_nothing_is_known_stands_still() -> None:
    assert (NOTHING_KNOWN.key, NOTHING_KNOWN.motion) == (UNKEYED, (AT_REST,))
    assert NOTHING_KNOWN.geometry is None
