"""Derivatives of pixels by direction, point and parameters, and of rays by pixels."""

from __future__ import annotations

from typing import Any

import numpy as np

from catoptra_protocol.optics.derivatives import (
    differentiate_direction,
    differentiate_point,
    differentiate_ray,
    parameter_names,
)
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import LENSES
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from stability.catalogue import Invalid
from stability.references.jacobian import MODELS, NUMBERS, values
from stability.references.mirror_jacobian import make_mirror


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


def _mirror_camera(mirror: str) -> OmniCamera:
    u, v, scale, up, *stretch = NUMBERS
    made, plane = make_mirror(mirror), ImagePlane((stretch[0], stretch[1], stretch[2], stretch[3]))
    return OmniCamera(made, 640, 480, (u, v), scale, made.rim_rad, up, plane=plane)


def _mirror_by_point(
    mirror: str, point: list[float], pinhole_m: float, is_far: bool, start: float
) -> Floats:
    camera = _mirror_camera(mirror)
    assert camera.mirror.pinhole_distance_m == pinhole_m
    differentiate = differentiate_direction if is_far else differentiate_point
    found = differentiate(camera, np.array(point))
    if not found.valid:
        raise Invalid("not seen")
    np.testing.assert_array_equal(found.by_pose[:, :3], -found.by_point)
    return np.concatenate((found.by_point, found.by_pose[:, 3:]))


def _mirror_by_pixel(mirror: str, pixel: list[float], start: float) -> Floats:
    found = differentiate_ray(_mirror_camera(mirror), np.array(pixel))
    if not found.valid:
        raise Invalid("not seen")
    return np.concatenate((found.origin_by_pixel, found.by_pixel))


SUBJECTS: dict[str, Any] = {
    "by_direction": _by_direction,
    "by_parameter": _by_parameter,
    "by_pixel": _by_pixel,
    "mirror_by_point": _mirror_by_point,
    "mirror_by_pixel": _mirror_by_pixel,
}
