"""One frame of a film to look at, with what was found in it and what was missed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from catoptra_client.experiment.degraded.film import Film
from catoptra_client.experiment.degraded.measures import Judged, Sightings, judgements
from catoptra_client.landmarks.histogram import Bytes

Pixel = tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A (h, w, 3) frame; where its beacons are that were found, and those missed; false ones.

    false_rad: bearings of detections of what is not there. centre_px: of the picture's mirror.
    """

    frame: Bytes
    found: tuple[Pixel, ...]
    missed: tuple[Pixel, ...]
    false_rad: tuple[float, ...]
    centre_px: Pixel


def sample(film: Film, found: Sightings) -> Sample:
    """Return the first of the frames that show most beacons within range."""
    judged = list(judgements(film, found))
    number = fullest(judged)
    shot, frame = film.shots[number], judged[number]
    places = {s.landmark.name: s.pixel for s in shot.landmarks if s.pixel is not None}
    return Sample(
        frame=shot.frame,
        found=tuple(places[name] for name in sorted(frame.found)),
        missed=tuple(places[name] for name in sorted(frame.visible - set(frame.found))),
        false_rad=tuple(one.bearing_rad for one in frame.false),
        centre_px=film.camera.centre_px,
    )


def changed(shown: Sample, clean: Sample) -> float:
    """Return the rms difference of two samples of the same place, in grey levels."""
    difference = shown.frame.astype(np.float64) - clean.frame
    return float(np.sqrt(np.mean(np.square(difference))))


def fullest(judged: Sequence[Judged]) -> int:
    """Return the index of the first frame with the most visible beacons."""
    counts = [len(frame.visible) for frame in judged]
    return counts.index(max(counts))
