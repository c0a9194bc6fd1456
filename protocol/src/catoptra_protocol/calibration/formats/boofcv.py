"""BoofCV's YAML of its universal omnidirectional model.

Law and frame as OpenCV's omnidir module. Source: BoofCV, CalibrationIO; its reader wants decimal
points in every number.
"""

from __future__ import annotations

from catoptra_protocol.calibration.calibrated_camera import Matrix, make_camera, matrix_from_camera
from catoptra_protocol.calibration.calibration_format import Conventions
from catoptra_protocol.calibration.files import (
    Fields,
    file_error,
    format_number,
    format_numbers,
    parse_yaml,
)
from catoptra_protocol.calibration.model_fits import unified_parameters
from catoptra_protocol.optics.lenses import UnifiedLens
from catoptra_protocol.optics.omni_camera import OmniCamera

NAME = "boofcv"
CONVENTIONS = Conventions(
    frame="x right, y down, z forward",
    first_pixel=0.0,
    fields="pinhole fx fy cx cy width height skew; mirror_offset; radial [k1, k2]; t1, t2",
)

_MODEL = "omnidirectional_universal"


def is_format(text: str) -> bool:
    """A file of the universal model."""
    return _MODEL in text


def read(text: str, file: str, camera: str) -> OmniCamera:
    """Camera of a file."""
    del camera  # a file has one
    document = parse_yaml(text, file)
    if not isinstance(document, dict):
        raise file_error(file, "model", _MODEL, value="missing")
    fields = Fields(file, document)
    fields.get_choice("model", (_MODEL,))
    pinhole, distortion = fields.get_child("pinhole"), fields.get_child("radial_tangential")
    xi = fields.get_number("mirror_offset")
    radial = distortion.get_numbers("radial") if distortion.has("radial") else ()
    if len(radial) > 2:
        raise distortion.make_error("radial", "at most two coefficients, k1 and k2")
    k1, k2 = (*radial, 0.0, 0.0)[:2]
    return make_camera(
        fields,
        lambda: UnifiedLens(xi, k1, k2),
        Matrix(
            pinhole.get_positive("fx"),
            pinhole.get_positive("fy"),
            pinhole.get_number("cx"),
            pinhole.get_number("cy"),
            pinhole.get_number("skew", 0.0),
        ),
        (pinhole.get_side_px("width"), pinhole.get_side_px("height")),
        p1=distortion.get_number("t1", 0.0),
        p2=distortion.get_number("t2", 0.0),
    )


def write(camera: OmniCamera, name: str) -> str:
    """Text of a file."""
    unified = unified_parameters(camera)
    matrix = matrix_from_camera(camera, unified.gamma_px)
    number = format_number
    return "\n".join(
        (
            f"# {name}",
            "pinhole:",
            f"  fx: {number(matrix.fx)}",
            f"  fy: {number(matrix.fy)}",
            f"  cx: {number(matrix.cx)}",
            f"  cy: {number(matrix.cy)}",
            f"  width: {camera.width_px}",
            f"  height: {camera.height_px}",
            f"  skew: {number(matrix.skew)}",
            f"mirror_offset: {number(unified.xi)}",
            "radial_tangential:",
            f"  radial: {format_numbers((unified.k1, unified.k2))}",
            f"  t1: {number(camera.plane.p1)}",
            f"  t2: {number(camera.plane.p2)}",
            f"model: {_MODEL}",
            "version: 0",
            "",
        )
    )
