"""The table of what a server says, and the header as people read it."""

from __future__ import annotations

from catoptra_protocol.wire.stream_answers import ANSWERS
from helpers.stream_messages import HEADER


def test_answers_are_kept_under_their_kinds() -> None:
    assert all(kind == form.KIND for kind, form in ANSWERS.items())


def test_header_when_logged_says_what_matters() -> None:
    assert str(HEADER) == "frame 42 of 'Omni', 6 x 4 px raw, 30.0 ms old"
