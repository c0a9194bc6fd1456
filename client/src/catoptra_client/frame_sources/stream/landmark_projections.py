"""Landmarks in replies of the stream: true positions, and projections into a camera."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.stream.replies import LandmarkRecord, LandmarksReply


@dataclass(frozen=True, slots=True)
class LandmarkProjection:
    """A landmark and its projection into a camera, by geometry."""

    landmark: Landmark
    pixel: tuple[float, float] | None
    """Projection (u, v) of the band centre; None outside the image."""
    visible: bool
    """Whether the band centre lies in the image without an occluder."""
    time_s: float
    """Simulation time."""


def landmarks_from_reply(reply: LandmarksReply) -> tuple[Landmark, ...]:
    """True landmarks of the world."""
    return tuple(map(_landmark_from_record, reply.landmarks))


def projections_from_reply(reply: LandmarksReply) -> tuple[LandmarkProjection, ...]:
    """Projection of each landmark."""
    # Only a reply without a camera has no time.
    time_s = reply.time_s or 0.0
    return tuple(
        LandmarkProjection(_landmark_from_record(one), one.pixel, bool(one.visible), time_s)
        for one in reply.landmarks
    )


def _landmark_from_record(record: LandmarkRecord) -> Landmark:
    fields = dataclasses.fields(Landmark)
    return Landmark(**{field.name: getattr(record, field.name) for field in fields})
