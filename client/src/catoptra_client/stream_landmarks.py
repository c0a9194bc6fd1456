"""What the stream says of landmarks: where they are, and what a camera sees of them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.wire.stream_answers import LandmarkRecord, LandmarksAre


@dataclass(frozen=True, slots=True)
class SeenLandmark:
    """A landmark, and what a camera saw of it at `time_s`, by geometry.

    pixel: (u, v) of the middle of its band, None outside the picture. visible: whether it lies in
    the picture with nothing before it.
    """

    landmark: Landmark
    pixel: tuple[float, float] | None
    visible: bool
    time_s: float


def landmarks_from_answer(answer: LandmarksAre) -> tuple[Landmark, ...]:
    """Return where the landmarks are."""
    return tuple(map(_landmark, answer.landmarks))


def seen_from_answer(answer: LandmarksAre) -> tuple[SeenLandmark, ...]:
    """Return what was seen of each landmark."""
    time_s = answer.time_s or 0.0
    return tuple(
        SeenLandmark(_landmark(one), one.pixel, bool(one.visible), time_s)
        for one in answer.landmarks
    )


def _landmark(record: LandmarkRecord) -> Landmark:
    fields = dataclasses.fields(Landmark)
    return Landmark(**{field.name: getattr(record, field.name) for field in fields})
