"""Pixel of a direction and back: centre, rim, tiny images, extreme vectors, NaN."""

from __future__ import annotations

from typing import Any

import numpy as np

from catoptra_protocol.optics import numerics, omni_camera
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.numerics import Bools, Floats
from stability.catalogue import Invalid


def valid_value(answer: tuple[Floats, Bools]) -> Floats:
    """Value, which is finite whether valid or not; raise Invalid if not valid."""
    value, valid = answer
    assert np.isfinite(value).all(), f"{value}: a value beside its mask is no number"
    if not valid:
        raise Invalid("not seen")
    return value


def _camera(inputs: dict[str, Any]) -> omni_camera.OmniCamera:
    return omni_camera.OmniCamera(
        projection=HyperbolicMirror(inputs["k"], 0.2),
        width_px=inputs["width_px"],
        height_px=inputs["height_px"],
        centre_px=(inputs["centre_px"][0], inputs["centre_px"][1]),
        scale_px=inputs["horizon_px"],
        rim_rad=inputs["rim_rad"],
        image_up_azimuth_rad=inputs["up_rad"],
    )


def _half_angle(direction: list[float]) -> Floats:
    return valid_value(numerics.half_angle_tangent(np.array(direction)))


def _pixel(direction: list[float], **of: Any) -> Floats:
    return valid_value(omni_camera.pixel_from_direction(_camera(of), np.array(direction)))


def _direction(pixel: list[float], **of: Any) -> Floats:
    return valid_value(omni_camera.direction_from_pixel(_camera(of), np.array(pixel)))


SUBJECTS = {
    "half_angle": _half_angle,
    "pixel_from_direction": _pixel,
    "direction_from_pixel": _direction,
}
