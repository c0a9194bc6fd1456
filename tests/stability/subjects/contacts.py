"""Contacts of a base: planes, edges, stones, hairs and giants."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from catoptra_server.simulation.resting import find_facet
from stability.catalogue import Invalid


def _sink(x: Sequence[float], y: Sequence[float], gaps: Sequence[float]) -> float:
    found = find_facet(np.array(x), np.array(y), np.array(gaps), (0, 0, 0), (0.0, 0.0))
    if found is None:
        raise Invalid("it falls")
    return found[0]


SUBJECTS = {"sink": _sink}
