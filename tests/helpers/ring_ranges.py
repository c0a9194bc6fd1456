"""The least range in each ring of the image, from frames of trace."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_server.effects import NUM_RINGS
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import World
from helpers.effect_measurement import CAMERA
from helpers.range_images import trace_ranges


def min_ring_ranges_m(world: World, exposure: CameraState) -> Floats:
    """(RINGS,) ranges, metres; inf for a ring without a surface."""
    pixels = pixel_sample_positions(CAMERA)[:, :, 0]
    on_mirror = direction_from_pixel(CAMERA, pixels)[1]
    radius = np.linalg.norm(pixels - np.array(CAMERA.centre_px), axis=-1) / CAMERA.rim_radius_px
    ring = np.where(on_mirror, np.minimum(NUM_RINGS * radius, NUM_RINGS - 1), NUM_RINGS).astype(int)
    range_m = trace_ranges(world, exposure)
    return np.array([range_m[ring == index].min() for index in range(NUM_RINGS)])
