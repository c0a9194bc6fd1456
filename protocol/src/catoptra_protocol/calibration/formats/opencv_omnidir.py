"""OpenCV's omnidir module: K, xi and D of `cv2.omnidir.calibrate`, as FileStorage writes them.

Law: X / |X|, divided by z + xi, distorted by D = k1 k2 p1 p2, then K with its skew K01. Frame: x
right, y down, z forward. OpenCV checks no domain. Source: opencv_contrib, modules/ccalib.
"""

from __future__ import annotations

from catoptra_protocol.calibration.calibrated_camera import Matrix, make_camera, matrix_from_camera
from catoptra_protocol.calibration.calibration_format import Conventions
from catoptra_protocol.calibration.files import Fields, file_error, format_number, parse_yaml
from catoptra_protocol.calibration.model_fits import unified_parameters
from catoptra_protocol.optics.lenses import UnifiedLens
from catoptra_protocol.optics.omni_camera import OmniCamera

NAME = "opencv_omnidir"
CONVENTIONS = Conventions(
    frame="x right, y down, z forward",
    first_pixel=0.0,
    fields="image_width, image_height, K (3 x 3, skew used), xi, D = k1 k2 p1 p2",
)


def is_format(text: str) -> bool:
    """A head of OpenCV with a matrix K and a sphere parameter."""
    return "opencv-matrix" in text and "xi" in text


def read(text: str, file: str, camera: str) -> OmniCamera:
    """Camera of a file."""
    del camera  # a file has one
    document = parse_yaml(text, file)
    if not isinstance(document, dict):
        raise file_error(file, "K", "a 3 x 3 matrix", value="missing")
    fields = Fields(file, document)
    k = fields.get_child("K").get_numbers("data", 9)
    if k[3] != 0.0 or k[6:] != (0.0, 0.0, 1.0):
        raise fields.get_child("K").make_error("data", "fx skew cx, 0 fy cy, 0 0 1")
    d = fields.get_child("D").get_numbers("data", 4)
    # cv2 returns xi as a matrix of one number, and scripts store it as it is.
    if isinstance(document.get("xi"), dict):
        (xi,) = fields.get_child("xi").get_numbers("data", 1)
    else:
        xi = fields.get_number("xi")
    for index, name in ((0, "fx"), (4, "fy")):
        if k[index] <= 0.0:
            raise fields.get_child("K").make_error("data", f"{name} above 0")
    return make_camera(
        fields,
        lambda: UnifiedLens(xi, d[0], d[1]),
        Matrix(k[0], k[4], k[2], k[5], k[1]),
        (fields.get_side_px("image_width"), fields.get_side_px("image_height")),
        p1=d[2],
        p2=d[3],
    )


def write(camera: OmniCamera, name: str) -> str:
    """Text of a file."""
    unified = unified_parameters(camera)
    matrix = matrix_from_camera(camera, unified.gamma_px)
    k = (matrix.fx, matrix.skew, matrix.cx, 0.0, matrix.fy, matrix.cy, 0.0, 0.0, 1.0)
    d = (unified.k1, unified.k2, camera.plane.p1, camera.plane.p2)
    # OpenCV wants %YAML as the first bytes of the file.
    return "\n".join(
        (
            "%YAML:1.0",
            "---",
            f'camera_name: "{name}"',
            f"image_width: {camera.width_px}",
            f"image_height: {camera.height_px}",
            *_matrix_lines("K", 3, 3, k),
            f"xi: {format_number(unified.xi)}",
            *_matrix_lines("D", 1, 4, d),
            "",
        )
    )


def _matrix_lines(name: str, rows: int, cols: int, values: tuple[float, ...]) -> tuple[str, ...]:
    data = ", ".join(map(format_number, values))
    return (
        f"{name}: !!opencv-matrix",
        f"   rows: {rows}",
        f"   cols: {cols}",
        "   dt: d",
        f"   data: [ {data} ]",
    )
