"""Perspective camera: image borders, and fields of view at their limits."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from stability.catalogue import Invalid


def _pixel(width_px: int, height_px: int, fov_rad: float, direction: list[float]) -> Floats:
    camera = PerspectiveCamera(width_px, height_px, fov_rad)
    value, valid = camera.pixel_from_direction(np.array(direction))
    return _lens_pixel(value, bool(valid))


def _direction(width_px: int, height_px: int, fov_rad: float, pixel: list[float]) -> Floats:
    camera = PerspectiveCamera(width_px, height_px, fov_rad)
    value, valid = camera.direction_from_pixel(np.array(pixel))
    return _lens_pixel(value, bool(valid))


def _lens_pixel(value: Floats, valid: bool) -> Floats:
    assert np.isfinite(value).all(), f"{value}: a value beside its mask is no number"
    if not valid:
        raise Invalid("not seen")
    return value


SUBJECTS = {"perspective_pixel": _pixel, "perspective_direction": _direction}
