"""CamOdoCal's YAML of the MEI model, as VINS and KITTI-360 use it.

Law and frame as OpenCV's omnidir module, without skew. Source: CamOdoCal, its CataCamera.
"""

from __future__ import annotations

from catoptra_protocol.calibration.calibrated_camera import Matrix, make_camera, matrix_from_camera
from catoptra_protocol.calibration.calibration_format import Conventions
from catoptra_protocol.calibration.files import Fields, file_error, format_number, parse_yaml
from catoptra_protocol.calibration.model_fits import unified_parameters
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import UnifiedLens
from catoptra_protocol.optics.omni_camera import OmniCamera

NAME = "camodocal"
CONVENTIONS = Conventions(
    frame="x right, y down, z forward",
    first_pixel=0.0,
    fields="mirror_parameters xi; distortion_parameters k1 k2 p1 p2; projection_parameters "
    "gamma1 gamma2 u0 v0",
)


def is_format(text: str) -> bool:
    """A file with a model type and mirror parameters."""
    return "model_type" in text and "mirror_parameters" in text


def read(text: str, file: str, camera: str) -> OmniCamera:
    """Camera of a file."""
    del camera  # a file has one
    document = parse_yaml(text, file)
    if not isinstance(document, dict):
        raise file_error(file, "model_type", "MEI", value="missing")
    fields = Fields(file, document)
    fields.get_choice("model_type", ("MEI", "mei"))
    distortion = fields.get_child("distortion_parameters")
    projection = fields.get_child("projection_parameters")
    xi = fields.get_child("mirror_parameters").get_number("xi")
    k1, k2, p1, p2 = (distortion.get_number(key) for key in ("k1", "k2", "p1", "p2"))
    return make_camera(
        fields,
        lambda: UnifiedLens(xi, k1, k2),
        Matrix(
            projection.get_positive("gamma1"),
            projection.get_positive("gamma2"),
            projection.get_number("u0"),
            projection.get_number("v0"),
        ),
        (fields.get_side_px("image_width"), fields.get_side_px("image_height")),
        p1=p1,
        p2=p2,
    )


def write(camera: OmniCamera, name: str) -> str:
    """Text of a file."""
    unified = unified_parameters(camera)
    matrix = matrix_from_camera(camera, unified.gamma_px)
    if matrix.skew != 0.0:
        raise DomainError("CamOdoCal has no skew")
    number = format_number
    return "\n".join(
        (
            "%YAML:1.0",
            "---",
            "model_type: MEI",
            f"camera_name: {name}",
            f"image_width: {camera.width_px}",
            f"image_height: {camera.height_px}",
            "mirror_parameters:",
            f"   xi: {number(unified.xi)}",
            "distortion_parameters:",
            f"   k1: {number(unified.k1)}",
            f"   k2: {number(unified.k2)}",
            f"   p1: {number(camera.plane.p1)}",
            f"   p2: {number(camera.plane.p2)}",
            "projection_parameters:",
            f"   gamma1: {number(matrix.fx)}",
            f"   gamma2: {number(matrix.fy)}",
            f"   u0: {number(matrix.cx)}",
            f"   v0: {number(matrix.cy)}",
            "",
        )
    )
