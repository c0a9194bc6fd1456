"""Basalt's calibration JSON: ucm, eucm, ds and kb4.

Frame: x right, y down, z forward. Source: basalt-headers, camera/*.hpp; its kb4 measures the angle
by atan2 and so holds beyond 90 degrees. Cameras of one file share the order of their resolutions.
"""

from __future__ import annotations

import json

from catoptra_protocol.calibration.calibrated_camera import Matrix, make_camera, matrix_from_camera
from catoptra_protocol.calibration.calibration_format import Conventions
from catoptra_protocol.calibration.files import Fields, parse_json
from catoptra_protocol.calibration.model_fits import unified_parameters
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import (
    DoubleSphereLens,
    EnhancedUnifiedLens,
    KannalaBrandtLens,
)
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import RadialProjection

NAME = "basalt"
CONVENTIONS = Conventions(
    frame="x right, y down, z forward",
    first_pixel=0.0,
    fields="intrinsics {fx, fy, cx, cy} with alpha (ucm); alpha, beta (eucm); xi, alpha (ds); k1 "
    "to k4 (kb4)",
)


def is_format(text: str) -> bool:
    """A JSON file with typed intrinsics."""
    return '"camera_type"' in text and '"value0"' in text


def read(text: str, file: str, camera: str) -> OmniCamera:
    """Camera of a file.

    Args:
        text: The file's text.
        file: Its path.
        camera: Name by its place, such as cam1; empty for cam0.
    """
    root = Fields(file, parse_json(text, file)).get_child("value0")
    listed = root.values.get("intrinsics")
    names = [f"cam{place}" for place in range(len(listed))] if isinstance(listed, list) else []
    root.check_camera(camera or "cam0", names)
    index = names.index(camera or "cam0")
    entry = root.get_item("intrinsics", index)
    kind = entry.get_choice("camera_type", ("ucm", "eucm", "ds", "kb4"))
    numbers = entry.get_child("intrinsics")
    matrix = Matrix(
        numbers.get_positive("fx"),
        numbers.get_positive("fy"),
        numbers.get_number("cx"),
        numbers.get_number("cy"),
    )
    resolutions = root.values.get("resolution")
    if not isinstance(resolutions, list) or len(resolutions) <= index:
        raise root.make_error("resolution", "[width, height] for each camera")
    size_px = Fields(file, {"resolution": resolutions[index]}, root.path).get_size_px("resolution")
    return make_camera(numbers, lambda: _lens(kind, numbers), matrix, size_px)


def _lens(kind: str, numbers: Fields) -> RadialProjection:
    number = numbers.get_number
    match kind:
        case "ucm":
            return EnhancedUnifiedLens(number("alpha"))
        case "eucm":
            return EnhancedUnifiedLens(number("alpha"), number("beta"))
        case "ds":
            return DoubleSphereLens(number("xi"), number("alpha"))
    return KannalaBrandtLens(number("k1"), number("k2"), number("k3"), number("k4"))


def write(camera: OmniCamera, name: str) -> str:
    """Text of a file with one camera."""
    kind, shape, scale_px = _model_of(camera)
    matrix = matrix_from_camera(camera, scale_px)
    if matrix.skew != 0.0 or camera.plane.is_decentred:
        raise DomainError("Basalt has neither skew nor tangential distortion")
    pose = {"px": 0.0, "py": 0.0, "pz": 0.0, "qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0}
    numbers = {"fx": matrix.fx, "fy": matrix.fy, "cx": matrix.cx, "cy": matrix.cy} | shape
    value = {
        "T_imu_cam": [pose],
        "intrinsics": [{"camera_type": kind, "intrinsics": numbers}],
        "resolution": [[camera.width_px, camera.height_px]],
        "vignette": [],
        "name": name,
    }
    return json.dumps({"value0": value}, indent=2) + "\n"


def _model_of(camera: OmniCamera) -> tuple[str, dict[str, float], float]:
    match camera.projection:
        case KannalaBrandtLens(k1, k2, k3, k4):
            return "kb4", {"k1": k1, "k2": k2, "k3": k3, "k4": k4}, camera.scale_px
        case EnhancedUnifiedLens(alpha, beta):
            return "eucm", {"alpha": alpha, "beta": beta}, camera.scale_px
        case DoubleSphereLens(xi, alpha):
            return "ds", {"xi": xi, "alpha": alpha}, camera.scale_px
    unified = unified_parameters(camera)
    if unified.is_distorted:
        raise DomainError("Basalt has no radial distortion behind a sphere")
    return "ucm", {"alpha": unified.alpha}, unified.focal_length_px
