"""Wide-angle lenses: image radius of an angle from the axis, and the inverse."""

from __future__ import annotations

from typing import Any

import numpy as np

from catoptra_protocol.optics.lenses import LENSES
from catoptra_protocol.optics.numerics import Floats
from stability.catalogue import Subject


def _subject(name: str) -> Subject:
    """Radius of a given t, or t of a given radius, of a lens."""

    def subject(**given: Any) -> Floats:
        of = "t" if "t" in given else "ratio"
        argument = np.array(given.pop(of))
        # Tables are tuples: lenses are compared and hashed by value.
        lens = LENSES[name](**{k: tuple(v) if isinstance(v, list) else v for k, v in given.items()})
        return (lens.radius_ratio_from_t if of == "t" else lens.t_from_radius_ratio)(argument)

    return subject


SUBJECTS = {name: _subject(name) for name in LENSES}
