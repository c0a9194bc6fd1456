"""A camera as files of all calibration formats that describe it well enough.

Each entry of `EXPORTS` is one model in one format. What differs from the camera by more than an
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
from catoptra_protocol.calibration.calibration_format import CalibrationFormat
from catoptra_protocol.calibration.formats import (
    basalt,
    boofcv,
    camodocal,
    kalibr,
    ocamcalib,
    opencv_omnidir,
    woodscape_json,
)
from catoptra_protocol.calibration.model_fits import (
    Residual,
    compute_residual,
    fit_double_sphere,
    fit_eucm,
    fit_kannala_brandt,
    fit_mei,
    fit_ocam,
    fit_ucm,
    fit_woodscape,
)
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.slotted_dataclass import dataclass

DEFAULT_MAX_RESIDUAL_PX = 0.05
"""Largest residual of an exported file, anywhere in the image."""
# Of pixels: rims of fits end between two of them.
_MAX_MISSING = 1e-3
_OCAM_DEGREES = range(4, 9)


@dataclass(frozen=True, slots=True)
class Export:
    """One model in one format."""

    name: str
    """Name by which a client asks for it."""
    file_name: str
    model: str
    """Model in words."""
    domain: str
    """Directions for which the format's own readers have a pixel."""
    format: CalibrationFormat
    fit: Callable[[OmniCamera], OmniCamera]
    """Camera in this model, as a reader of the file makes it."""


@dataclass(frozen=True, slots=True)
class ExportedFile:
    """A file that describes a camera."""

    export: Export
    text: str
    camera: OmniCamera
    """Camera that a reader of the file makes, up to the end of its model or image."""
    residual: Residual


@dataclass(frozen=True, slots=True)
class RefusedFile:
    """A model that does not describe a camera."""

    export: Export
    reason: str
    """In words, with the residual where there is one."""


def _fit_ocam(camera: OmniCamera) -> OmniCamera:
    """OCamCalib's model of the lowest degree, from 4 on, that is good enough, or the best."""
    best, best_px = fit_ocam(camera, degree=_OCAM_DEGREES[0]), math.inf
    for degree in _OCAM_DEGREES:
        fitted = fit_ocam(camera, degree=degree)
        max_px = compute_residual(camera, fitted).max_px
        if max_px < best_px:
            best, best_px = fitted, max_px
        if best_px <= 0.1 * DEFAULT_MAX_RESIDUAL_PX:
            break
    return best


# Four formats have Mei's model, two each of the others.
@lru_cache(maxsize=32)
def _fit_and_compare(
    fit: Callable[[OmniCamera], OmniCamera], camera: OmniCamera
) -> tuple[OmniCamera, Residual]:
    """Camera in a model, and its residual."""
    model = fit(camera)
    return model, compute_residual(camera, model)


_UNSTATED, _OMNI = "none", "z > -w |X|, w = xi or 1 / xi"
_EUCM, _DS = "z > -w d (RA-L 2016)", "z > -w2 |X| (3DV 2018)"

EXPORTS: tuple[Export, ...] = (
    Export(
        "opencv_omnidir",
        "opencv_omnidir.yaml",
        "Mei, cv2.omnidir",
        _UNSTATED,
        opencv_omnidir,
        fit_mei,
    ),
    Export("camodocal", "camodocal_mei.yaml", "Mei, CamOdoCal", _UNSTATED, camodocal, fit_mei),
    Export("boofcv", "boofcv.yaml", "Mei, BoofCV", _UNSTATED, boofcv, fit_mei),
    Export("kalibr_omni", "kalibr_omni.yaml", "Mei, Kalibr", _OMNI, kalibr, fit_mei),
    Export("kalibr_eucm", "kalibr_eucm.yaml", "EUCM, Kalibr", _EUCM, kalibr, fit_eucm),
    Export("kalibr_ds", "kalibr_ds.yaml", "double sphere, Kalibr", _DS, kalibr, fit_double_sphere),
    Export(
        "kalibr_equi",
        "kalibr_equi.yaml",
        "Kannala-Brandt, Kalibr",
        "z > 0",
        kalibr,
        fit_kannala_brandt,
    ),
    Export("basalt_ucm", "basalt_ucm.json", "UCM, Basalt", _EUCM, basalt, fit_ucm),
    Export("basalt_eucm", "basalt_eucm.json", "EUCM, Basalt", _EUCM, basalt, fit_eucm),
    Export("basalt_ds", "basalt_ds.json", "double sphere, Basalt", _DS, basalt, fit_double_sphere),
    Export(
        "basalt_kb4",
        "basalt_kb4.json",
        "Kannala-Brandt, Basalt",
        _UNSTATED,
        basalt,
        fit_kannala_brandt,
    ),
    Export("ocamcalib", "ocamcalib.txt", "OCam polynomial", _UNSTATED, ocamcalib, _fit_ocam),
    Export(
        "woodscape",
        "woodscape.json",
        "polynomial of the angle",
        _UNSTATED,
        woodscape_json,
        fit_woodscape,
    ),
)
"""Models and formats, in the order of the report."""


def export_camera(
    camera: OmniCamera,
    export: Export,
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
    try:
        model, residual = _fit_and_compare(export.fit, described)
        text = export.format.write(model, name)
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
