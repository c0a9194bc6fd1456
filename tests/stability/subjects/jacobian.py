"""Derivatives of pixels by direction and parameters, and of directions by pixels."""

from __future__ import annotations

from typing import Any

import numpy as np

from catoptra_protocol.optics.derivatives import (
    differentiate_direction,
    differentiate_ray,
    parameter_names,
)
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import LENSES
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from stability.catalogue import Invalid
from stability.references.jacobian import MODELS, values


def _camera(model: str, rim_rad: float) -> OmniCamera:
    u, v, scale, up, *rest = values(model)
    stretch = (rest[0], rest[1], rest[2], rest[3])
    tangential = (rest[4], rest[5]) if model == "unified" else ()
    shape = {k: tuple(x) if isinstance(x, list) else x for k, x in MODELS[model][0].items()}
    projection = HyperbolicMirror(shape["k"], 0.2) if model == "hyperbolic" else None
    return OmniCamera(
        projection or LENSES[model](**shape),
        640,
        480,
        (u, v),
        scale,
        rim_rad,
        up,
        plane=ImagePlane(stretch, *tangential),
    )


def _by_direction(model: str, direction: list[float], rim_rad: float) -> Floats:
    found = differentiate_direction(_camera(model, rim_rad), np.array(direction))
    assert np.isfinite(found.by_point).all()
    if not found.valid:
        raise Invalid("not seen")
    return found.by_point


def _by_parameter(model: str, direction: list[float], rim_rad: float, parameter: str) -> Floats:
    camera = _camera(model, rim_rad)
    found = differentiate_direction(camera, np.array(direction))
    column: Floats = found.by_parameters[:, parameter_names(camera).index(parameter)]
    return column


def _by_pixel(model: str, direction: list[float], rim_rad: float) -> Floats:
    camera = _camera(model, rim_rad)
    pixel, _ = camera.pixel_from_direction(np.array(direction))
    return differentiate_ray(camera, pixel).by_pixel


SUBJECTS: dict[str, Any] = {
    "by_direction": _by_direction,
    "by_parameter": _by_parameter,
    "by_pixel": _by_pixel,
}
