"""The sharp exposures that an exposure which lasts is the mean of: everything where it is then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from catoptra_server.capture.camera_state import CameraState
from catoptra_server.capture.shutter import RowWeights


def sample_shutter(
    camera_state: CameraState, num_rows: int
) -> list[tuple[CameraState, RowWeights]]:
    """Return the sharp exposures that one is the mean of, and the weight of each by row.

    What counts in no row is left out. Without a shutter it is the exposure itself.
    """
    shutter = camera_state.shutter
    if shutter is None:
        return [(camera_state, np.ones(num_rows, dtype=np.float32))]
    weights = shutter.row_weights(num_rows)
    shots = zip(shutter.times_s, weights, strict=True)
    return [(advance(camera_state, time_s), share) for time_s, share in shots if share.any()]


def advance(camera_state: CameraState, time_s: float) -> CameraState:
    """Return the sharp exposure some seconds later, everything carried on by its own motion."""
    bodies = (
        replace(body, world_from_object=body.twist.integrate_pose(body.world_from_object, time_s))
        for body in camera_state.objects
    )
    return replace(
        camera_state,
        world_from_mirror=camera_state.twist.integrate_pose(camera_state.world_from_mirror, time_s),
        objects=tuple(bodies),
        shutter=None,
    )
