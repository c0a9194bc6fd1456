"""Displacements by an effect, measured in images of the pixel coordinates themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_server.effects import ImageEffect, SceneSummary
from helpers.effect_measurement import CAMERA, CAPTURE_CONTEXT

THRESHOLD_PX = 0.5


def add_margin(camera: OmniCamera = CAMERA, margin_px: int = 12) -> OmniCamera:
    """Camera in a larger image, so that nothing is read from outside."""
    return replace(
        camera,
        width_px=camera.width_px + 2 * margin_px,
        height_px=camera.height_px + 2 * margin_px,
        centre_px=(camera.centre_px[0] + margin_px, camera.centre_px[1] + margin_px),
    )


def measure_displacement_px(effect: ImageEffect, camera: OmniCamera) -> Floats:
    """Displacement, (h, w, 3) px, of each pixel of the mirror from the origin of its light.

    0 in pixels whose light the effect takes or lessens, and outside the mirror.
    """
    pixels = pixel_sample_positions(camera)[:, :, 0]
    on_mirror = direction_from_pixel(camera, pixels)[1]
    image = effect.apply(np.ones((*on_mirror.shape, 3)), camera, CAPTURE_CONTEXT)
    moved = np.zeros_like(image)
    for axis in (0, 1):
        ramp = np.repeat(pixels[..., axis, None], 3, axis=-1)
        moved = np.hypot(moved, effect.apply(ramp, camera, CAPTURE_CONTEXT) - ramp)
    return np.where((image == 1.0) & on_mirror[..., None], moved, 0.0)


def assert_displacement_negligible(effect: ImageEffect, camera: OmniCamera) -> None:
    """Assert that an effect displaces little by its bound, and in images."""
    bound = effect.bound(SceneSummary(1.0), camera)
    assert bound.displacement_px <= THRESHOLD_PX
    assert (
        measure_displacement_px(effect, camera).max() <= bound.displacement_px * (1.0 + 1e-6) + 1e-6
    )


def assert_displacement_not_negligible(effect: ImageEffect, camera: OmniCamera) -> None:
    """Assert that an effect displaces much, but not more than its bound."""
    bound = effect.bound(SceneSummary(1.0), camera)
    assert bound.displacement_px > THRESHOLD_PX
    assert bound.reason
    moved = float(measure_displacement_px(effect, camera).max())
    assert 0.5 * THRESHOLD_PX < moved <= bound.displacement_px * (1.0 + 1e-6)
