"""The least ranges that each ring of the image shows, of frames that trace draws."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.camera import direction_from_pixel, pixel_centres
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.scene_summary import RINGS
from catoptra_server.render.renderer import Exposure
from catoptra_server.scene.description import World
from helpers.effects import CAMERA
from helpers.ranges import traced


def nearest_seen_m(world: World, exposure: Exposure) -> Floats:
    """Return (RINGS,) ranges in metres; inf where a ring shows nothing."""
    pixels = pixel_centres(CAMERA)[:, :, 0]
    on_mirror = direction_from_pixel(CAMERA, pixels)[1]
    radius = np.linalg.norm(pixels - np.array(CAMERA.centre_px), axis=-1) / CAMERA.rim_radius_px
    ring = np.where(on_mirror, np.minimum(RINGS * radius, RINGS - 1), RINGS).astype(int)
    range_m = traced(world, exposure)
    return np.array([range_m[ring == index].min() for index in range(RINGS)])
