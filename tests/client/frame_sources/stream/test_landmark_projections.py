"""Landmarks in replies of the stream."""

from __future__ import annotations

import dataclasses

from catoptra_client.frame_sources.stream.stream_client import (
    LandmarkProjection,
    landmarks_from_reply,
    projections_from_reply,
)
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.stream.replies import LandmarksReply
from helpers.stream_messages import LANDMARK

EXPECTED_LANDMARK = Landmark("a", "beacon", 1.0, 2.0, 0.1, 0.0, 0.2, 0.4, "cyan", "yellow")


def test_landmarks_when_received_are_as_in_the_file() -> None:
    assert landmarks_from_reply(LandmarksReply(1, (LANDMARK,))) == (EXPECTED_LANDMARK,)


def test_landmarks_when_projected_have_pixel_and_time() -> None:
    visible = dataclasses.replace(LANDMARK, pixel=(3.0, 4.0), visible=True)
    hidden = dataclasses.replace(LANDMARK, pixel=None, visible=False)
    assert projections_from_reply(LandmarksReply(1, (visible, hidden), 1.5)) == (
        LandmarkProjection(EXPECTED_LANDMARK, (3.0, 4.0), True, 1.5),
        LandmarkProjection(EXPECTED_LANDMARK, None, False, 1.5),
    )
