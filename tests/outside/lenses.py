"""Pixels of directions by every foreign implementation of a lens model that a registry has.

Each model has a formula transcribed from its publication, and programs: OpenCV, COLMAP, DS-MSP,
WCSLIB (in astropy; its zenithal projections ARC, ZEA, STG, SIN and the polynomial ZPN are lenses),
SciPy's spline. All compute in float64. Programs are asked within their own domain alone: COLMAP's
and OpenCV's fish-eyes take atan(rho / z), which ends at 90 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np

from catoptra_protocol.optics.image_plane import NO_CHANGE, ImagePlane
from catoptra_protocol.optics.lenses import (
    DoubleSphereLens,
    EnhancedUnifiedLens,
    EquidistantLens,
    EquisolidLens,
    FThetaLens,
    KannalaBrandtLens,
    OCamLens,
    OrthographicLens,
    RadialTableLens,
    StereographicLens,
    UnifiedLens,
    WoodScapeLens,
)
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from helpers.calibrated_cameras import flipped_points
from outside.findings import (
    TRANSCRIBED,
    Finding,
    summarize,
    version_of,
)

# A float64 of 1 000 px has roundings of 1e-13 px; dozens of operations and a root follow.
BOUND_PX = 1e-9
# Of 100 000 points, for a mutant, which most of them notice.
_MUTANT_STEP = 100
# (n, 3) points, x right, y down, z ahead, and the camera: (n, 2) pixels, their centres at integers.
Project = Callable[[Floats, OmniCamera], Floats]
Radius = Callable[[Any, Floats], Floats]


@dataclass(frozen=True, slots=True)
class LensCase:
    """A lens model with numbers, mostly of a shipped camera, and who else computes it."""

    name: str
    camera: OmniCamera
    source: str
    """Publication of the formula."""
    radius: Radius
    """Image radius over the scale, of the lens and (n,) angles from the axis."""
    programs: dict[str, Project] = field(default_factory=dict)
    """By the package that has it."""


def _solve(value: Callable[[Floats], Floats], target: Floats, high: float) -> Floats:
    """Arguments in 0 to `high` of an increasing function, by bisection to the last digit."""
    low, upper = np.zeros_like(target), np.full_like(target, high)
    for _ in range(64):
        middle = 0.5 * (low + upper)
        below = value(middle) < target
        low, upper = np.where(below, middle, low), np.where(below, upper, middle)
    return 0.5 * (low + upper)


def _polynomial(terms: tuple[float, ...]) -> Callable[[Floats], Floats]:
    return lambda x: np.asarray(np.polynomial.polynomial.polyval(x, terms))


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
    height = _polynomial(lens.polynomial)
    return _solve(lambda rho: np.arctan2(rho, height(rho)), theta, 450.0)


def _f_theta(lens: Any, theta: Floats) -> Floats:
    return _solve(_polynomial((0.0, lens.k1, lens.k2, lens.k3, lens.k4)), theta, 800.0)


def _kannala(lens: Any, theta: Floats) -> Floats:
    return _polynomial((0, 1, 0, lens.k1, 0, lens.k2, 0, lens.k3, 0, lens.k4))(theta)


def _woodscape(lens: Any, theta: Floats) -> Floats:
    return _polynomial((0.0, lens.k1, lens.k2, lens.k3, lens.k4))(theta)


def _cubic_table(lens: Any, theta: Floats) -> Floats:
    # The numbers of the example below: a spline through a cubic is the cubic.
    return np.asarray(_TABLE[0] * theta + _TABLE[1] * theta**3)


def project_transcribed(case: LensCase, points: Floats) -> Floats:
    """Pixels by the publication: radius, Brown's p1 and p2 for the unified model, matrix."""
    camera, plane = case.camera, case.camera.plane
    rho = np.hypot(points[:, 0], points[:, 1])
    theta = np.arctan2(rho, points[:, 2])
    unit = points[:, :2] / np.where(rho > 0.0, rho, 1.0)[:, None]
    x, y = (unit * case.radius(camera.projection, theta)[:, None]).T
    if plane.p1 or plane.p2:
        lens: Any = camera.projection
        u, v = (unit * (np.sin(theta) / (np.cos(theta) + lens.xi))[:, None]).T
        r2 = u**2 + v**2
        x = x + 2.0 * plane.p1 * u * v + plane.p2 * (r2 + 2.0 * u**2)
        y = y + plane.p1 * (r2 + 2.0 * v**2) + 2.0 * plane.p2 * u * v
    return _to_pixels(camera, x, y)


def _to_pixels(camera: OmniCamera, x: Floats, y: Floats) -> Floats:
    a, b, c, d = camera.plane.stretch
    offset = np.stack((a * x + b * y, c * x + d * y), axis=-1)
    return np.asarray(camera.centre_px + camera.scale_px * offset - 0.5)


def _matrix(camera: OmniCamera) -> Floats:
    a, b, _, d = np.array(camera.plane.stretch) * camera.scale_px
    u, v = np.array(camera.centre_px) - 0.5
    return np.array(((a, b, u), (0.0, d, v), (0.0, 0.0, 1.0)))


def _front(points: Floats) -> Bools:
    return np.asarray(points[:, 2] > 1e-3)


def _mask(points: Floats, pixels: Floats) -> Floats:
    return np.where(_front(points)[:, None], pixels, np.nan)


def _opencv_fisheye(points: Floats, camera: OmniCamera) -> Floats:
    lens: Any = camera.projection
    terms = [getattr(lens, f"k{i}", 0.0) for i in range(1, 5)]
    zero = np.zeros(3)
    found = cv2.fisheye.projectPoints(points[None], zero, zero, _matrix(camera), np.array(terms))
    return _mask(points, found[0][0])


def _opencv_omnidir(points: Floats, camera: OmniCamera) -> Floats:
    lens: Any = camera.projection
    xi = getattr(lens, "xi", 1.0)
    scale = 1.0 if hasattr(lens, "xi") else 2.0
    matrix = _matrix(camera)
    matrix[:2, :2] *= scale
    terms = (getattr(lens, "k1", 0.0), getattr(lens, "k2", 0.0), camera.plane.p1, camera.plane.p2)
    zero = np.zeros((1, 3))
    found = cv2.omnidir.projectPoints(points[None], zero, zero, matrix, xi, np.array(terms))
    return np.asarray(found[0][0])


def _colmap(model: str, *names: str, to_front: bool = True) -> Project:
    def project(points: Floats, camera: OmniCamera) -> Floats:
        import pycolmap

        matrix = _matrix(camera)
        numbers = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
        numbers += [getattr(camera.projection, name) for name in names]
        foreign = pycolmap.Camera(
            model=model, width=camera.width_px, height=camera.height_px, params=numbers
        )
        found = np.asarray(foreign.img_from_cam(points, False))
        return _mask(points, found) if to_front else found

    return project


def _ds_msp(model: str, *names: str) -> Project:
    def project(points: Floats, camera: OmniCamera) -> Floats:
        import ds_msp.models

        matrix = _matrix(camera)
        numbers = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
        numbers += [getattr(camera.projection, name) for name in names]
        return np.asarray(getattr(ds_msp.models, model)(*numbers).project(points)[0])

    return project


def _ds_msp_unified(points: Floats, camera: OmniCamera) -> Floats:
    import ds_msp.models

    lens: Any = camera.projection
    matrix, alpha = _matrix(camera), lens.xi / (1.0 + lens.xi)
    f = (matrix[0, 0] * (1.0 - alpha), matrix[1, 1] * (1.0 - alpha), *matrix[:2, 2])
    return np.asarray(ds_msp.models.UCMModel(*f, alpha).project(points)[0])


def _ds_msp_ocam(points: Floats, camera: OmniCamera) -> Floats:
    import ds_msp.models

    lens: Any = camera.projection
    # Its polynomial has the other sign and is one of rho / 100; its affine matrix ends with 1.
    terms = [-a * 100.0**power for power, a in enumerate(lens.polynomial)]
    a, b, c, d = camera.plane.stretch
    assert d == 1.0
    u, v = np.array(camera.centre_px) - 0.5
    found = np.asarray(ds_msp.models.OCamModel(u, v, a, b, c, *terms).project(points)[0])
    # Its Newton starts at a0 / cot(theta), and misses the root next to 90 degrees.
    return np.where(np.abs(points[:, 2:]) > 1e-3, found, np.nan)


def _wcs(code: str, terms: Callable[[Any], tuple[float, ...]] = lambda _: ()) -> Project:
    """WCSLIB's zenithal projection: radii in degrees of a circle, radii 1 in radians."""

    def project(points: Floats, camera: OmniCamera) -> Floats:
        from astropy.wcs import WCS

        numbers = terms(camera.projection)
        wcs = WCS(naxis=2)
        wcs.wcs.ctype = [f"RA---{code}", f"DEC--{code}"]
        wcs.wcs.crval, wcs.wcs.crpix, wcs.wcs.cdelt = [0.0, 90.0], [0.0, 0.0], [1.0, 1.0]
        wcs.wcs.set_pv([(2, power, number) for power, number in enumerate(numbers)])
        rho = np.hypot(points[:, 0], points[:, 1])
        theta = np.degrees(np.arctan2(rho, points[:, 2]))
        if code == "ZPN" and isinstance(camera.projection, FThetaLens):
            # Exchanged: the polynomial has the angle for a radius of 100 px units.
            world = wcs.wcs.p2s(np.stack((np.zeros_like(theta), theta), axis=-1), 1)["theta"]
            radius = np.radians(90.0 - world) * _F_THETA_UNIT_PX
        else:
            sky = np.stack((np.full_like(theta, 30.0), 90.0 - theta), axis=-1)
            flat = wcs.wcs.s2p(sky, 1)["imgcrd"]
            radius = np.radians(np.hypot(flat[:, 0], flat[:, 1]))
        x, y = (points[:, :2] / np.where(rho > 0.0, rho, 1.0)[:, None] * radius[:, None]).T
        return _to_pixels(camera, x, y)

    return project


def _scipy_spline(points: Floats, camera: OmniCamera) -> Floats:
    from scipy.interpolate import CubicSpline

    lens: Any = camera.projection
    # Odd about the axis: no second derivative there.
    ends = ((2, 0.0), "not-a-knot")
    spline = CubicSpline(np.radians(lens.angles_deg), lens.radii, bc_type=ends)
    rho = np.hypot(points[:, 0], points[:, 1])
    radius = spline(np.arctan2(rho, points[:, 2]))
    x, y = (points[:, :2] / np.where(rho > 0.0, rho, 1.0)[:, None] * radius[:, None]).T
    return _to_pixels(camera, x, y)


_F_THETA_UNIT_PX = 200.0


def _f_theta_terms(lens: Any) -> tuple[float, ...]:
    numbers = (0.0, lens.k1, lens.k2, lens.k3, lens.k4)
    return tuple(number * _F_THETA_UNIT_PX**power for power, number in enumerate(numbers))


def _eye(
    lens: Any,
    scale_px: float,
    rim_deg: float,
    plane: ImagePlane = NO_CHANGE,
    size: tuple[int, int] = (640, 640),
    centre_px: tuple[float, float] = (320.3, 318.9),
) -> OmniCamera:
    rim = math.radians(rim_deg)
    return OmniCamera(lens, *size, centre_px, scale_px, rim, 0.0, Picture.FLIPPED, plane)


_TABLE = (200.0, -8.0)
_KNOTS_DEG = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0, 90.0, 105.0)
_CUBIC_RADII = tuple(float(_TABLE[0] * a + _TABLE[1] * a**3) for a in np.radians(_KNOTS_DEG))
_MIYAMOTO = "Miyamoto, JOSA 54 (1964)"
_MEI = "Mei & Rives, ICRA 2007"
_ASPECT = ImagePlane((1.0, 0.0, 0.0, 0.9999))


def lens_cases() -> list[LensCase]:
    """All lens models, with the numbers of published calibrations where there are any."""
    kb = KannalaBrandtLens(0.00348239, 0.00071503, -0.00205324, 0.00020294)
    kaidan = UnifiedLens(0.9809737, -0.15502748, 0.01681087)
    decentred = ImagePlane((1.0, 0.002, 0.0, 0.9985), 0.00109327, 0.00040638)
    lafida = OCamLens(
        (209.200757992065, 0.0, -0.00213741670953883, 4.2203617319086e-6, -1.77146086919594e-8)
    )
    affine = ImagePlane((0.999626131079017, -0.0034775192597376, 0.00385134991673147, 1.0))
    return [
        LensCase("equidistant", _eye(EquidistantLens(), 166.0, 110.0), _MIYAMOTO,
                 lambda _, a: a, {"opencv-contrib-python-headless": _opencv_fisheye,
                 "pycolmap": _colmap("FISHEYE"), "astropy": _wcs("ARC")}),
        LensCase("equisolid", _eye(EquisolidLens(), 195.0, 110.0), _MIYAMOTO,
                 lambda _, a: 2.0 * np.sin(0.5 * a), {"astropy": _wcs("ZEA")}),
        LensCase("stereographic", _eye(StereographicLens(), 112.0, 110.0), _MIYAMOTO,
                 lambda _, a: 2.0 * np.tan(0.5 * a),
                 {"opencv-contrib-python-headless": _opencv_omnidir, "astropy": _wcs("STG")}),
        LensCase("orthographic", _eye(OrthographicLens(), 321.0, 85.0), _MIYAMOTO,
                 lambda _, a: np.sin(a), {"astropy": _wcs("SIN")}),
        LensCase("kannala_brandt", _eye(kb, 190.97848, 97.5, _ASPECT),
                 "Kannala & Brandt, PAMI 28 (2006)", _kannala,
                 {"opencv-contrib-python-headless": _opencv_fisheye,
                  "pycolmap": _colmap("OPENCV_FISHEYE", "k1", "k2", "k3", "k4"),
                  "ds-msp": _ds_msp("KannalaBrandtModel", "k1", "k2", "k3", "k4"),
                  "astropy": _wcs("ZPN", lambda n: (0, 1, 0, n.k1, 0, n.k2, 0, n.k3, 0, n.k4))}),
        LensCase("unified, distorted", _eye(kaidan, 158.231834, 120.0, decentred), _MEI, _unified,
                 {"opencv-contrib-python-headless": _opencv_omnidir}),
        LensCase("unified", _eye(UnifiedLens(1.7), 300.0, 110.0, _ASPECT), _MEI, _unified,
                 {"opencv-contrib-python-headless": _opencv_omnidir, "ds-msp": _ds_msp_unified}),
        LensCase("enhanced_unified", _eye(EnhancedUnifiedLens(0.62, 1.08), 150.0, 95.0, _ASPECT),
                 "Khomutenko et al., RA-L 2016", _enhanced,
                 {"pycolmap": _colmap("EUCM", "alpha", "beta", to_front=False),
                  "ds-msp": _ds_msp("EUCMModel", "alpha", "beta")}),
        LensCase("double_sphere", _eye(DoubleSphereLens(-0.17213, 0.59312), 158.286, 97.5, _ASPECT),
                 "Usenko et al., 3DV 2018", _double_sphere,
                 {"ds-msp": _ds_msp("DoubleSphereModel", "xi", "alpha")}),
        LensCase("ocam", _eye(lafida, 1.0, 92.5, affine, (754, 480), (392.72, 243.99)),
                 "Scaramuzza et al., IROS 2006", _ocam, {"ds-msp": _ds_msp_ocam}),
        LensCase("woodscape", _eye(WoodScapeLens(339.749, -31.988, 48.275, -7.201), 1.0, 95.0,
                                   size=(1280, 966), centre_px=(643.942, 479.907)),
                 "Yogamani et al., ICCV 2019", _woodscape,
                 {"astropy": _wcs("ZPN", lambda n: (0, n.k1, n.k2, n.k3, n.k4))}),
        LensCase("f_theta", _eye(FThetaLens(3.1e-3, 2e-7, 1.5e-9, -4e-13), 1.0, 100.0,
                                 size=(1280, 1280)),
                 "NVIDIA DriveWorks, fthetaPoly", _f_theta,
                 {"astropy": _wcs("ZPN", _f_theta_terms)}),
        LensCase("radial_table", _eye(RadialTableLens(_KNOTS_DEG, _CUBIC_RADII), 1.0, 104.0),
                 "a cubic spline through a cubic is the cubic", _cubic_table,
                 {"scipy": _scipy_spline}),
    ]  # fmt: skip


def compare_lens(case: LensCase, camera: OmniCamera | None = None) -> Iterator[Finding]:
    """Compare a case's camera with all that compute it, or a mutant of it with its formula."""
    points, _, _ = flipped_points(case.camera)
    programs: dict[str, Project | None] = {TRANSCRIBED: None, **case.programs}
    if camera is not None:
        points, programs = points[::_MUTANT_STEP], {TRANSCRIBED: None}
    ours, valid = _pixels_of(camera or case.camera, points)
    for program, project in programs.items():
        theirs = project(points, case.camera) if project else project_transcribed(case, points)
        asked = valid & np.isfinite(theirs).all(axis=-1)
        apart = np.hypot(*(ours - theirs)[asked].T)
        authority = f"{case.source}, transcribed" if project is None else version_of(program)
        ends = points[asked, 2].min() > 0.0 and points[:, 2].min() < 0.0
        note = "to 90 degrees, its domain" if ends else ""
        yield summarize(case.name, authority, apart, BOUND_PX, "px", note=note)


def _pixels_of(camera: OmniCamera, points: Floats) -> tuple[Floats, Bools]:
    # Mirror frame with the image's top along +x: x = -down, y = right.
    direction = np.stack((-points[:, 1], points[:, 0], points[:, 2]), axis=-1)
    pixel, valid = camera.pixel_from_direction(direction)
    return pixel - 0.5, valid
