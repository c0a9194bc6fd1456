"""WoodScape's calibration JSON: radial_poly, the image radius as a polynomial of the angle.

Law: r = k1 theta + ... + k4 theta^4 in px, v times aspect_ratio. Frame: x right, y down, z forward.
Centre at width / 2 - 0.5 + cx_offset, first pixel 0. Source: valeoai/WoodScape, projection.py.
"""

from __future__ import annotations

import json

from catoptra_protocol.calibration.calibrated_camera import Matrix, make_camera, matrix_from_camera
from catoptra_protocol.calibration.calibration_format import Conventions
from catoptra_protocol.calibration.files import Fields, parse_json
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import WoodScapeLens
from catoptra_protocol.optics.omni_camera import OmniCamera

NAME = "woodscape"
CONVENTIONS = Conventions(
    frame="x right, y down, z forward",
    first_pixel=0.0,
    fields="k1 to k4, cx_offset, cy_offset, aspect_ratio, width, height",
)


def is_format(text: str) -> bool:
    """A JSON file of a radial polynomial."""
    return '"radial_poly"' in text


def read(text: str, file: str, camera: str) -> OmniCamera:
    """Camera of a file."""
    del camera  # a file has one
    fields = Fields(file, parse_json(text, file)).get_child("intrinsic")
    fields.get_choice("model", ("radial_poly",))
    if fields.get_number("poly_order", 4.0) != 4.0:
        raise fields.make_error("poly_order", "4")
    width, height = fields.get_side_px("width"), fields.get_side_px("height")
    k = tuple(fields.get_number(f"k{index}") for index in (1, 2, 3, 4))
    matrix = Matrix(
        1.0,
        fields.get_positive("aspect_ratio"),
        0.5 * width - 0.5 + fields.get_number("cx_offset"),
        0.5 * height - 0.5 + fields.get_number("cy_offset"),
    )
    return make_camera(fields, lambda: WoodScapeLens(*k), matrix, (width, height))


def write(camera: OmniCamera, name: str) -> str:
    """Text of a file."""
    lens = camera.projection
    if not isinstance(lens, WoodScapeLens):
        raise DomainError(f"{type(lens).__name__} is no polynomial of the angle")
    matrix = matrix_from_camera(camera, 1.0)
    if matrix.skew != 0.0 or camera.plane.stretch[0] != 1.0 or camera.plane.is_decentred:
        raise DomainError("WoodScape has an aspect ratio, but no skew and no distortion")
    # The polynomial is in pixels of this image: a scaled camera scales its coefficients.
    k1, k2, k3, k4 = (camera.scale_px * k for k in (lens.k1, lens.k2, lens.k3, lens.k4))
    intrinsic = {
        "model": "radial_poly",
        "poly_order": 4,
        "k1": k1,
        "k2": k2,
        "k3": k3,
        "k4": k4,
        "cx_offset": matrix.cx - 0.5 * camera.width_px + 0.5,
        "cy_offset": matrix.cy - 0.5 * camera.height_px + 0.5,
        "aspect_ratio": matrix.fy,
        "width": float(camera.width_px),
        "height": float(camera.height_px),
    }
    return json.dumps({"intrinsic": intrinsic, "name": name}, indent=2) + "\n"
