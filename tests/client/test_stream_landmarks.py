"""Landmarks as the stream tells of them."""

from __future__ import annotations

import dataclasses

from catoptra_client.stream_landmarks import (
    SeenLandmark,
    landmarks_from_answer,
    seen_from_answer,
)
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.wire.stream_answers import LandmarksAre
from helpers.stream_messages import LANDMARK

MARK = Landmark("a", "beacon", 1.0, 2.0, 0.1, 0.0, 0.2, 0.4, "cyan", "yellow")


def test_landmarks_when_told_are_as_in_the_file() -> None:
    assert landmarks_from_answer(LandmarksAre(1, (LANDMARK,))) == (MARK,)


def test_landmarks_when_seen_have_their_pixel_and_the_moment() -> None:
    seen = dataclasses.replace(LANDMARK, pixel=(3.0, 4.0), visible=True)
    hidden = dataclasses.replace(LANDMARK, pixel=None, visible=False)
    assert seen_from_answer(LandmarksAre(1, (seen, hidden), 1.5)) == (
        SeenLandmark(MARK, (3.0, 4.0), True, 1.5),
        SeenLandmark(MARK, None, False, 1.5),
    )
