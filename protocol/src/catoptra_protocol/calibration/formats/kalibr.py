"""Kalibr's camchain: omni, eucm, ds and pinhole with equidistant distortion.

Laws: omni x / (z + xi |X|) with radtan k1 k2 p1 p2 or none, fu = gamma; eucm and ds as published;
equidistant is Kannala-Brandt with four terms. Frame: x right, y down, z forward. Source: Kalibr,
its camera models and its reader of chains, which refuses whole focal lengths.
"""

from __future__ import annotations

from collections.abc import Callable

from catoptra_protocol.calibration.calibrated_camera import Matrix, make_camera, matrix_from_camera
from catoptra_protocol.calibration.calibration_format import Conventions
from catoptra_protocol.calibration.files import Fields, file_error, format_numbers, parse_yaml
from catoptra_protocol.calibration.model_fits import unified_parameters
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.lenses import (
    DoubleSphereLens,
    EnhancedUnifiedLens,
    KannalaBrandtLens,
    UnifiedLens,
)
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import RadialProjection

NAME = "kalibr"
CONVENTIONS = Conventions(
    frame="x right, y down, z forward",
    first_pixel=0.0,
    fields="omni [xi, fu, fv, pu, pv]; eucm [alpha, beta, fu, fv, pu, pv]; ds [xi, alpha, fu, fv, "
    "pu, pv]; pinhole [fu, fv, pu, pv]; radtan [k1, k2, p1, p2]; equidistant [k1, k2, k3, k4]",
)

_MODELS = ("omni", "eucm", "ds", "pinhole")


def is_format(text: str) -> bool:
    """A file of cameras with models and distortion models."""
    return "camera_model" in text and "distortion_model" in text


def read(text: str, file: str, camera: str) -> OmniCamera:
    """Camera of a file.

    Args:
        text: The file's text.
        file: Its path.
        camera: Name in the chain, such as cam1; empty for cam0.
    """
    document = parse_yaml(text, file)
    if not isinstance(document, dict):
        raise file_error(file, "cam0", "a camera", value="missing")
    chain, name = Fields(file, document), camera or "cam0"
    chain.check_camera(name, [key for key, each in document.items() if isinstance(each, dict)])
    fields = chain.get_child(name)
    model = fields.get_choice("camera_model", _MODELS)
    lens, matrix = _read_intrinsics(fields, model)
    distortion_model = fields.get_choice("distortion_model", ("none", "radtan", "equidistant"))
    distortion = fields.get_numbers("distortion_coeffs")
    size_px = fields.get_size_px("resolution")
    if model == "pinhole" and distortion_model == "equidistant":
        k = fields.get_numbers("distortion_coeffs", 4)
        return make_camera(fields, lambda: KannalaBrandtLens(*k), matrix, size_px)
    if model == "pinhole":
        expected = "equidistant: a flat image is an ordinary camera's"
        raise fields.make_error("distortion_model", expected)
    if distortion_model == "none":
        fields.get_numbers("distortion_coeffs", 0)
        return make_camera(fields, lambda: lens(0.0, 0.0), matrix, size_px)
    if model != "omni" or distortion_model != "radtan":
        expected = "none" if model != "omni" else "none or radtan: omni has no other"
        raise fields.make_error("distortion_model", expected)
    if len(distortion) != 4:
        raise fields.make_error("distortion_coeffs", "k1, k2, p1, p2")
    k1, k2, p1, p2 = distortion
    return make_camera(fields, lambda: lens(k1, k2), matrix, size_px, p1=p1, p2=p2)


def _read_intrinsics(
    fields: Fields, model: str
) -> tuple[Callable[[float, float], RadialProjection], Matrix]:
    count = {"omni": 1, "eucm": 2, "ds": 2, "pinhole": 0}[model]
    values = fields.get_numbers("intrinsics", count + 4)
    shape, (fu, fv, pu, pv) = values[:count], values[count:]
    if fu <= 0.0 or fv <= 0.0:
        raise fields.make_error("intrinsics", "fu and fv above 0")
    matrix = Matrix(fu, fv, pu, pv)
    match model:
        case "omni":
            return (lambda k1, k2: UnifiedLens(shape[0], k1, k2)), matrix
        case "eucm":
            return (lambda _k1, _k2: EnhancedUnifiedLens(shape[0], shape[1])), matrix
        case "ds":
            return (lambda _k1, _k2: DoubleSphereLens(shape[0], shape[1])), matrix
    return (lambda _k1, _k2: KannalaBrandtLens()), matrix


def write(camera: OmniCamera, name: str) -> str:
    """Text of a chain with one camera."""
    model, intrinsics, scale_px, distortion = _model_of(camera)
    matrix = matrix_from_camera(camera, scale_px)
    if matrix.skew != 0.0:
        raise DomainError("Kalibr has no skew")
    distortion_model = "none" if not distortion else "radtan"
    if model == "pinhole":
        distortion_model = "equidistant"
    numbers = (*intrinsics, matrix.fx, matrix.fy, matrix.cx, matrix.cy)
    return "\n".join(
        (
            "cam0:",
            f"  camera_model: {model}",
            f"  intrinsics: {format_numbers(numbers)}",
            f"  distortion_model: {distortion_model}",
            f"  distortion_coeffs: {format_numbers(distortion)}",
            f"  resolution: [{camera.width_px}, {camera.height_px}]",
            f"  rostopic: /{name}/image_raw",
            "",
        )
    )


def _model_of(
    camera: OmniCamera,
) -> tuple[str, tuple[float, ...], float, tuple[float, ...]]:
    """Model, its parameters, pixels of its focal length, and distortion."""
    plane = camera.plane
    match camera.projection:
        case KannalaBrandtLens(k1, k2, k3, k4):
            return "pinhole", (), camera.scale_px, (k1, k2, k3, k4)
        case EnhancedUnifiedLens(alpha, beta):
            return "eucm", (alpha, beta), camera.scale_px, ()
        case DoubleSphereLens(xi, alpha):
            return "ds", (xi, alpha), camera.scale_px, ()
    unified = unified_parameters(camera)
    distorted = unified.is_distorted or plane.is_decentred
    distortion = (unified.k1, unified.k2, plane.p1, plane.p2) if distorted else ()
    return "omni", (unified.xi,), unified.gamma_px, distortion
