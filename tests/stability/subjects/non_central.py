"""Mirrors without a viewpoint: image radius of an angle from the axis."""

from __future__ import annotations

from typing import Any

import numpy as np

from catoptra_protocol.optics.mirrors import MIRRORS
from catoptra_protocol.optics.numerics import Floats
from stability.catalogue import Subject


def _subject(name: str) -> Subject:
    """Image radius of a mirror with these parameters."""

    def subject(t: float, **given: Any) -> Floats:
        # Tables are tuples: mirrors are compared and hashed by value.
        parameters = {k: tuple(v) if isinstance(v, list) else v for k, v in given.items()}
        return MIRRORS[name](**parameters).radius_ratio_from_t(np.array(t))

    return subject


SUBJECTS = {name: _subject(name) for name in MIRRORS}
