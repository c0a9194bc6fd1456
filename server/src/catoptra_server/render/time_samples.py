"""Time samples of a long exposure: sharp camera states whose mean is the exposure.

Raster and the float64 reference render each of them (`sample_shutter`); the native kernel takes the
poses of the whole exposure (`trajectory`) and chooses the instants of each part of the image.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from catoptra_server.world.camera_state import CameraState, RowWeights

# Between two rotations 2 degrees apart the entries are those of a rotation to 2e-4.
_MAX_TURN_RAD = 0.035
# A robot that spins for the longest exposure of a minute: coarser, but bounded.
_MAX_TURNS = 256


def sample_shutter(
    camera_state: CameraState, num_rows: int
) -> list[tuple[CameraState, RowWeights]]:
    """Sharp camera states of an exposure, and the weight of each by row.

    Samples that weigh nothing in every row are left out. Without a shutter the only sample is the
    camera state itself.

    Args:
        camera_state: Camera state with its shutter.
        num_rows: Rows of the image.

    Returns:
        Pairs of a camera state without a shutter and (num_rows,) weights.
    """
    shutter = camera_state.shutter
    if shutter is None:
        return [(camera_state, np.ones(num_rows, dtype=np.float32))]
    weights = shutter.row_weights(num_rows)
    samples = zip(shutter.times_s, weights, strict=True)
    return [
        (advance(camera_state, time_s), row_weights)
        for time_s, row_weights in samples
        if row_weights.any()
    ]


def trajectory(camera_state: CameraState) -> tuple[CameraState, ...]:
    """Sharp camera states, evenly spaced from the begin to the end of an exposure.

    Two, or as many as turns take for poses between two of them to be interpolated entry by entry.
    Without a shutter the only state is the camera state itself.
    """
    shutter = camera_state.shutter
    if shutter is None:
        return (camera_state,)
    total_s = shutter.exposure_s + shutter.readout_s
    twists = (camera_state.twist, *(placed.twist for placed in camera_state.objects))
    turn_rad = total_s * max(math.hypot(*twist.angular_rad_s) for twist in twists)
    steps = min(1 + int(turn_rad / _MAX_TURN_RAD), _MAX_TURNS)
    return tuple(advance(camera_state, (i / steps - 0.5) * total_s) for i in range(steps + 1))


def advance(camera_state: CameraState, time_s: float) -> CameraState:
    """Camera state at a later time, with camera and objects carried on by their own twists."""
    objects = (
        replace(
            dynamic_object,
            world_from_object=dynamic_object.twist.integrate_pose(
                dynamic_object.world_from_object, time_s
            ),
        )
        for dynamic_object in camera_state.objects
    )
    # The noise seed stays: all samples belong to one exposure, which draws its noise once at the
    # end.
    return replace(
        camera_state,
        world_from_mirror=camera_state.twist.integrate_pose(camera_state.world_from_mirror, time_s),
        objects=tuple(objects),
        shutter=None,
    )
