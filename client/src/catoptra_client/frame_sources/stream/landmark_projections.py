"""What the stream says of landmarks: where they are, and what a camera sees of them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.stream.replies import LandmarkRecord, LandmarksReply


@dataclass(frozen=True, slots=True)
class LandmarkProjection:
    """A landmark, and what a camera saw of it at `time_s`, by geometry.

    pixel: (u, v) of the middle of its band, None outside the picture. visible: whether it lies in
    the picture with nothing before it.
    """

    landmark: Landmark
    pixel: tuple[float, float] | None
    visible: bool
    time_s: float


def landmarks_from_reply(reply: LandmarksReply) -> tuple[Landmark, ...]:
    """Return where the landmarks are."""
    return tuple(map(_landmark_from_record, reply.landmarks))


def projections_from_reply(reply: LandmarksReply) -> tuple[LandmarkProjection, ...]:
    """Return what was seen of each landmark."""
    time_s = reply.time_s or 0.0
    return tuple(
        LandmarkProjection(_landmark_from_record(one), one.pixel, bool(one.visible), time_s)
        for one in reply.landmarks
    )


def _landmark_from_record(record: LandmarkRecord) -> Landmark:
    fields = dataclasses.fields(Landmark)
    return Landmark(**{field.name: getattr(record, field.name) for field in fields})
