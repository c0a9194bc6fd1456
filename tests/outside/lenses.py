"""Pixels of directions by every foreign implementation of a lens model that a registry has.

Each model has a formula transcribed from its publication, and programs: OpenCV, COLMAP, DS-MSP,
WCSLIB (in astropy; its zenithal projections ARC, ZEA, STG, SIN and the polynomial ZPN are lenses),
SciPy's spline. All compute in float64. Programs are asked within their own domain alone: COLMAP's
and OpenCV's fish-eyes take atan(rho / z), which ends at 90 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.polynomial.polynomial import polyval

from catoptra_protocol.optics import lenses
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from helpers.calibrated_cameras import (
    LAFIDA,
    THETA_BACK,
    TUM_VI,
    TUM_VI_KB,
    WOODSCAPE,
    flipped_points,
)
from outside.findings import Finding, bisect, summarize, version_of

# A float64 of 1 000 px has roundings of 1e-13 px; dozens of operations and a root follow.
BOUND_PX = 1e-9
# Of 100 000 points, for a mutant, which most of them notice.
_MUTANT_STEP = 100
# (n, 3) points, x right, y down, z ahead, and the camera: (n, 2) pixels, their centres at integers.
Project = Callable[[Floats, OmniCamera], Floats]


@dataclass(frozen=True, slots=True)
class LensCase:
    """A lens model with numbers, mostly of a shipped camera, and who else computes it."""

    name: str
    camera: OmniCamera
    source: str
    """Publication of the formula."""
    radius: Callable[[Any, Floats], Floats]
    """Image radius over the scale, of the lens and (n,) angles from the axis."""
    programs: dict[str, Project]
    """By the package that has it."""


def _unified(lens: Any, theta: Floats) -> Floats:
    m = np.sin(theta) / (np.cos(theta) + lens.xi)
    return np.asarray(m * (1.0 + lens.k1 * m**2 + lens.k2 * m**4))


def _enhanced(lens: Any, theta: Floats) -> Floats:
    rho, z = np.sin(theta), np.cos(theta)
    d = np.sqrt(lens.beta * rho**2 + z**2)
    return np.asarray(rho / (lens.alpha * d + (1.0 - lens.alpha) * z))


def _double_sphere(lens: Any, theta: Floats) -> Floats:
    rho, z = np.sin(theta), np.cos(theta) + lens.xi
    d2 = np.sqrt(rho**2 + z**2)
    return np.asarray(rho / (lens.alpha * d2 + (1.0 - lens.alpha) * z))


def _ocam(lens: Any, theta: Floats) -> Floats:
    return bisect(lambda rho: np.arctan2(rho, polyval(rho, lens.polynomial)), theta, 450.0)


def _terms(lens: Any, unit: float = 1.0) -> tuple[float, ...]:
    """Polynomial of WoodScape and f-theta, of an argument in a unit."""
    numbers = (0.0, lens.k1, lens.k2, lens.k3, lens.k4)
    return tuple(number * unit**power for power, number in enumerate(numbers))


def _odd_terms(lens: Any) -> tuple[float, ...]:
    return (0.0, 1.0, 0.0, lens.k1, 0.0, lens.k2, 0.0, lens.k3, 0.0, lens.k4)


def _angles(points: Floats) -> Floats:
    return np.asarray(np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2]))


def _to_pixels(camera: OmniCamera, points: Floats, radius: Floats) -> Floats:
    """Pixels of image radii in the azimuths of points, by Brown's p1 and p2 and the matrix."""
    plane, lens, theta = camera.plane, camera.projection, _angles(points)
    rho = np.hypot(points[:, 0], points[:, 1])
    unit = points[:, :2].T / np.where(rho > 0.0, rho, 1.0)
    x, y = unit * radius
    if plane.p1 or plane.p2:
        u, v = unit * np.sin(theta) / (np.cos(theta) + lens.xi)  # type: ignore[attr-defined]
        r2 = u**2 + v**2
        x = x + 2.0 * plane.p1 * u * v + plane.p2 * (r2 + 2.0 * u**2)
        y = y + plane.p1 * (r2 + 2.0 * v**2) + 2.0 * plane.p2 * u * v
    a, b, c, d = plane.stretch
    offset = np.stack((a * x + b * y, c * x + d * y), axis=-1)
    return np.asarray(camera.centre_px + camera.scale_px * offset - 0.5)


def project_transcribed(case: LensCase, points: Floats) -> Floats:
    """Pixels by the publication."""
    radius = case.radius(case.camera.projection, _angles(points))
    return _to_pixels(case.camera, points, radius)


def _matrix(camera: OmniCamera) -> Floats:
    a, b, _, d = np.array(camera.plane.stretch) * camera.scale_px
    u, v = np.array(camera.centre_px) - 0.5
    return np.array(((a, b, u), (0.0, d, v), (0.0, 0.0, 1.0)))


def _numbers(camera: OmniCamera, names: tuple[str, ...]) -> list[float]:
    """Focal lengths, centre, and the lens's own."""
    matrix = _matrix(camera)
    own = [getattr(camera.projection, name) for name in names]
    return [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *own]


def _in_front(points: Floats, pixels: Floats) -> Floats:
    return np.where(points[:, 2:] > 1e-3, pixels, np.nan)


def _opencv_fisheye(points: Floats, camera: OmniCamera) -> Floats:
    terms = np.array([getattr(camera.projection, f"k{i}", 0.0) for i in range(1, 5)])
    zero = np.zeros(3)
    found = cv2.fisheye.projectPoints(points[None], zero, zero, _matrix(camera), terms)
    return _in_front(points, found[0][0])


def _opencv_omnidir(points: Floats, camera: OmniCamera) -> Floats:
    lens, matrix = camera.projection, _matrix(camera)
    # A stereographic lens is that of xi = 1 and twice the scale.
    matrix[:2, :2] *= 1.0 if hasattr(lens, "xi") else 2.0
    terms = (getattr(lens, "k1", 0.0), getattr(lens, "k2", 0.0), camera.plane.p1, camera.plane.p2)
    zero, xi = np.zeros((1, 3)), getattr(lens, "xi", 1.0)
    found = cv2.omnidir.projectPoints(points[None], zero, zero, matrix, xi, np.array(terms))
    return np.asarray(found[0][0])


def _colmap(model: str, *names: str) -> Project:
    def project(points: Floats, camera: OmniCamera) -> Floats:
        import pycolmap

        foreign = pycolmap.Camera(model=model, width=camera.width_px, height=camera.height_px,
                                  params=_numbers(camera, names))  # fmt: skip
        found = np.asarray(foreign.img_from_cam(points, False))
        return _in_front(points, found) if "FISHEYE" in model else found

    return project


def _ds_msp(model: str, *names: str) -> Project:
    def project(points: Floats, camera: OmniCamera) -> Floats:
        import ds_msp.models

        numbers = _numbers(camera, names)
        if model == "UCMModel":
            alpha = numbers[4] / (1.0 + numbers[4])
            numbers = [f * (1.0 - alpha) for f in numbers[:2]] + [*numbers[2:4], alpha]
        return np.asarray(getattr(ds_msp.models, model)(*numbers).project(points)[0])

    return project


def _ds_msp_ocam(points: Floats, camera: OmniCamera) -> Floats:
    import ds_msp.models

    lens: Any = camera.projection
    # Its polynomial has the other sign and is one of rho / 100; its affine matrix ends with 1.
    terms = [-a * 100.0**power for power, a in enumerate(lens.polynomial)]
    u, v = np.array(camera.centre_px) - 0.5
    model = ds_msp.models.OCamModel(u, v, *camera.plane.stretch[:3], *terms)
    # Its Newton starts at a0 / cot(theta), and misses the root next to 90 degrees.
    return np.where(np.abs(points[:, 2:]) > 1e-3, model.project(points)[0], np.nan)


def _wcs(code: str, terms: Callable[[Any], tuple[float, ...]] = lambda _: ()) -> Project:
    """WCSLIB's zenithal projection: radii in degrees of a circle, radii 1 in radians."""

    def project(points: Floats, camera: OmniCamera) -> Floats:
        from astropy.wcs import WCS

        wcs = WCS(naxis=2)
        wcs.wcs.ctype = [f"RA---{code}", f"DEC--{code}"]
        wcs.wcs.crval, wcs.wcs.crpix, wcs.wcs.cdelt = [0.0, 90.0], [0.0, 0.0], [1.0, 1.0]
        wcs.wcs.set_pv([(2, *term) for term in enumerate(terms(camera.projection))])
        theta = np.degrees(_angles(points))
        if isinstance(camera.projection, lenses.FThetaLens):
            # Exchanged: the polynomial has the angle, of a radius in a unit.
            world = wcs.wcs.p2s(np.stack((np.zeros_like(theta), theta), axis=-1), 1)["theta"]
            return _to_pixels(camera, points, np.radians(90.0 - world) * _F_THETA_UNIT_PX)
        sky = np.stack((np.full_like(theta, 30.0), 90.0 - theta), axis=-1)
        flat = wcs.wcs.s2p(sky, 1)["imgcrd"]
        return _to_pixels(camera, points, np.radians(np.hypot(flat[:, 0], flat[:, 1])))

    return project


def _scipy_spline(points: Floats, camera: OmniCamera) -> Floats:
    from scipy.interpolate import CubicSpline

    lens: Any = camera.projection
    # Odd about the axis: no second derivative there.
    ends = ((2, 0.0), "not-a-knot")
    spline = CubicSpline(np.radians(lens.angles_deg), lens.radii, bc_type=ends)
    return _to_pixels(camera, points, spline(_angles(points)))


def _eye(lens: Any, scale_px: float, rim_deg: float, aspect: float = 1.0) -> OmniCamera:
    return OmniCamera(lens, 640, 640, (320.3, 318.9), scale_px, math.radians(rim_deg), 0.0,
                      Picture.FLIPPED, ImagePlane((1.0, 0.0, 0.0, aspect)))  # fmt: skip


_F_THETA_UNIT_PX = 200.0
_CUBIC = (0.0, 200.0, 0.0, -8.0)
_KNOTS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0, 105.0)
_CUBIC_RADII = tuple(polyval(np.radians(_KNOTS_DEG), _CUBIC).tolist())
_MIYAMOTO, _MEI = "Miyamoto, JOSA 54 (1964)", "Mei & Rives, ICRA 2007"
_KB = ("k1", "k2", "k3", "k4")


def lens_cases() -> list[LensCase]:
    """All lens models, with the numbers of published calibrations where there are any."""
    opencv = "opencv-contrib-python-headless"
    # DS-MSP's affine matrix ends with 1.
    lafida = replace(LAFIDA, plane=ImagePlane((*LAFIDA.plane.stretch[:3], 1.0)))
    f_theta = lenses.FThetaLens(3.1e-3, 2e-7, 1.5e-9, -4e-13)
    table = lenses.RadialTableLens(_KNOTS_DEG, _CUBIC_RADII)
    return [
        LensCase("equidistant", _eye(lenses.EquidistantLens(), 166.0, 110.0), _MIYAMOTO,
                 lambda _, a: a,
                 {opencv: _opencv_fisheye, "pycolmap": _colmap("FISHEYE"), "astropy": _wcs("ARC")}),
        LensCase("equisolid", _eye(lenses.EquisolidLens(), 195.0, 110.0), _MIYAMOTO,
                 lambda _, a: 2.0 * np.sin(0.5 * a), {"astropy": _wcs("ZEA")}),
        LensCase("stereographic", _eye(lenses.StereographicLens(), 112.0, 110.0), _MIYAMOTO,
                 lambda _, a: 2.0 * np.tan(0.5 * a),
                 {opencv: _opencv_omnidir, "astropy": _wcs("STG")}),
        LensCase("orthographic", _eye(lenses.OrthographicLens(), 321.0, 85.0), _MIYAMOTO,
                 lambda _, a: np.sin(a), {"astropy": _wcs("SIN")}),
        LensCase("kannala_brandt", TUM_VI_KB, "Kannala & Brandt, PAMI 28 (2006)",
                 lambda lens, a: polyval(a, _odd_terms(lens)),
                 {opencv: _opencv_fisheye, "pycolmap": _colmap("OPENCV_FISHEYE", *_KB),
                  "ds-msp": _ds_msp("KannalaBrandtModel", *_KB),
                  "astropy": _wcs("ZPN", _odd_terms)}),
        LensCase("unified, distorted", THETA_BACK, _MEI, _unified, {opencv: _opencv_omnidir}),
        LensCase("unified", _eye(lenses.UnifiedLens(1.7), 300.0, 110.0, 0.9999), _MEI, _unified,
                 {opencv: _opencv_omnidir, "ds-msp": _ds_msp("UCMModel", "xi")}),
        LensCase("enhanced_unified",
                 _eye(lenses.EnhancedUnifiedLens(0.62, 1.08), 150.0, 95.0, 0.9999),
                 "Khomutenko et al., RA-L 2016", _enhanced,
                 {"pycolmap": _colmap("EUCM", "alpha", "beta"),
                  "ds-msp": _ds_msp("EUCMModel", "alpha", "beta")}),
        LensCase("double_sphere", TUM_VI, "Usenko et al., 3DV 2018", _double_sphere,
                 {"ds-msp": _ds_msp("DoubleSphereModel", "xi", "alpha")}),
        LensCase("ocam", lafida, "Scaramuzza et al., IROS 2006", _ocam, {"ds-msp": _ds_msp_ocam}),
        LensCase("woodscape", WOODSCAPE, "Yogamani et al., ICCV 2019",
                 lambda lens, a: polyval(a, _terms(lens)), {"astropy": _wcs("ZPN", _terms)}),
        LensCase("f_theta", _eye(f_theta, 1.0, 100.0), "NVIDIA DriveWorks, fthetaPoly",
                 lambda lens, a: bisect(lambda r: polyval(r, _terms(lens)), a, 800.0),
                 {"astropy": _wcs("ZPN", lambda lens: _terms(lens, _F_THETA_UNIT_PX))}),
        LensCase("radial_table", _eye(table, 1.0, 104.0),
                 "a cubic spline through a cubic is the cubic", lambda _, a: polyval(a, _CUBIC),
                 {"scipy": _scipy_spline}),
    ]  # fmt: skip


def compare_lens(case: LensCase, camera: OmniCamera | None = None) -> Iterator[Finding]:
    """Compare a case's camera with all that compute it, or a mutant of it with its formula."""
    points, _, _ = flipped_points(case.camera)
    if camera is not None:
        points = points[::_MUTANT_STEP]
    # Mirror frame with the image's top along +x: x = -down, y = right.
    direction = np.stack((-points[:, 1], points[:, 0], points[:, 2]), axis=-1)
    ours, valid = (camera or case.camera).pixel_from_direction(direction)
    theirs = {f"{case.source}, transcribed": project_transcribed(case, points)}
    if camera is None:
        theirs |= {version_of(p): f(points, case.camera) for p, f in case.programs.items()}
    for authority, pixels in theirs.items():
        asked = valid & np.isfinite(pixels).all(axis=-1)
        apart = np.hypot(*(ours - 0.5 - pixels)[asked].T)
        ends = points[asked, 2].min() > 0.0 and points[:, 2].min() < 0.0
        note = "to 90 degrees, its domain" if ends else ""
        yield summarize(case.name, authority, apart, BOUND_PX, "px", note=note)
