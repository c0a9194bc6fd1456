"""A camera as files of all calibration formats that describe it well enough.

Each row of `FORMATS` is one model in one format. What differs from the camera by more than an
allowed number of pixels, anywhere in the image, is refused with that number.

The command allows 0.05 px. `model_fits` converts exactly where a camera is of the model, and fits
the whole image elsewhere; `ray_table` describes any camera. Tests read the files by projectors of
the published formulas, and OpenCV calibrates rendered boards.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

from catoptra_protocol.calibration.calibrated_camera import mark_picture
from catoptra_protocol.calibration.formats import CalibrationFormat
from catoptra_protocol.calibration.model_fits import Residual, compute_residual
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.slotted_dataclass import dataclass

DEFAULT_MAX_RESIDUAL_PX = 0.05
"""Largest residual of an exported file, anywhere in the image."""
# Of pixels: rims of fits end between two of them.
_MAX_MISSING = 1e-3


@dataclass(frozen=True, slots=True)
class ExportedFile:
    """A file that describes a camera."""

    export: CalibrationFormat
    text: str
    camera: OmniCamera
    """Camera that a reader of the file makes, up to the end of its model or image."""
    residual: Residual


@dataclass(frozen=True, slots=True)
class RefusedFile:
    """A model that does not describe a camera."""

    export: CalibrationFormat
    reason: str
    """In words, with the residual where there is one."""


# Each model is fitted once for all of its formats.
@lru_cache(maxsize=32)
def _fit_and_compare(
    fit: Callable[[OmniCamera], OmniCamera], camera: OmniCamera
) -> tuple[OmniCamera, Residual]:
    """Camera in a model, and its residual."""
    model = fit(camera)
    return model, compute_residual(camera, model)


def export_camera(
    camera: OmniCamera,
    export: CalibrationFormat,
    *,
    name: str,
    picture: Picture,
    max_residual_px: float = DEFAULT_MAX_RESIDUAL_PX,
) -> ExportedFile | RefusedFile:
    """One file that describes a camera, or why there is none.

    Args:
        camera: The camera, whatever its own hand.
        export: Model and format.
        name: Name of the camera in the file.
        picture: Hand of the pictures that the file is to describe.
        max_residual_px: Largest residual anywhere in the image.
    """
    if not camera.is_central:
        return RefusedFile(export, "the rays of this mirror do not meet in one viewpoint")
    described = turn_for_export(camera, picture)
    if camera.rim_rad > export.max_angle_rad * (1.0 + 1e-12):
        shown_deg = math.degrees(2.0 * camera.rim_rad)
        reason = f"its readers take {export.domain} alone, and this image shows {shown_deg:.3f} deg"
        return RefusedFile(export, f"{reason}: a field of view of 180 leaves the rest out")
    try:
        model, residual = _fit_and_compare(export.model.fit, described)
        simple = export.simplify(model)
        if simple != model:
            model, residual = simple, compute_residual(described, simple)
        text = export.write(model, name)
    except DomainError as error:
        return RefusedFile(export, str(error))
    if not residual.max_px <= max_residual_px:
        return RefusedFile(export, f"off by up to {residual.max_px:.3g} px")
    if residual.fraction_missing > _MAX_MISSING:
        share = 100.0 * residual.fraction_missing
        return RefusedFile(export, f"no direction for {share:.2g} % of the image")
    return ExportedFile(export, mark_picture(text, picture), model, residual)


def turn_for_export(camera: OmniCamera, picture: Picture) -> OmniCamera:
    """The camera of pictures of a hand, as if they were flipped ones: all formats are right-handed.

    A mirrored picture is the flipped picture of a mirrored world, with a frame whose x points left.
    """
    turned = camera.with_picture(picture)
    if picture is Picture.FLIPPED:
        return turned
    return replace(turned, picture=Picture.FLIPPED, plane=turned.plane.mirror())
