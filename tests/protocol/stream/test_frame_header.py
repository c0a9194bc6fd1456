"""The log text of a header."""

from __future__ import annotations

from helpers.stream_messages import HEADER


def test_header_when_logged_names_camera_size_and_age() -> None:
    assert str(HEADER) == "frame 42 of 'Omni', 6 x 4 px raw, 30.0 ms old"
