"""The sharp exposures that an exposure which lasts is the mean of: everything where it is then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from catoptra_server.render.renderer import Exposure
from catoptra_server.render.shutter import Weights


def instants(exposure: Exposure, rows: int) -> list[tuple[Exposure, Weights]]:
    """Return the sharp exposures that one is the mean of, and the weight of each by row.

    What counts in no row is left out. Without a shutter it is the exposure itself.
    """
    shutter = exposure.shutter
    if shutter is None:
        return [(exposure, np.ones(rows, dtype=np.float32))]
    weights = shutter.weights(rows)
    shots = zip(shutter.times_s, weights, strict=True)
    return [(at(exposure, time_s), share) for time_s, share in shots if share.any()]


def at(exposure: Exposure, time_s: float) -> Exposure:
    """Return the sharp exposure some seconds later, everything carried on by its own motion."""
    bodies = (
        replace(body, world_from_body=body.twist.carried(body.world_from_body, time_s))
        for body in exposure.bodies
    )
    return replace(
        exposure,
        world_from_mirror=exposure.twist.carried(exposure.world_from_mirror, time_s),
        bodies=tuple(bodies),
        shutter=None,
    )
