"""A camera from a calibration's numbers by canonical names, and back; and the mark of its hand.

All formats describe right-handed cameras, so a file says nothing of the hand of the pictures that
it was made from, and a mirrored world fits as well. Catoptra's own mark, a comment or a field, says
which pictures a file is of. Files of other programs have no mark.

A file of the other hand than the requested pictures is an error, not a mirror image.
"""

from __future__ import annotations

import math
import re
from collections.abc import Set
from dataclasses import fields, replace
from itertools import count, takewhile

import numpy as np

from catoptra_protocol.calibration.files import file_error
from catoptra_protocol.calibration.templates import Numbers
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.image_plane import (
    DistortedProjection,
    ImagePlane,
    decentred_fold_rad,
)
from catoptra_protocol.optics.lenses import OCamLens, UnifiedLens, WoodScapeLens
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import (
    WITHIN_LIMIT,
    Picture,
    RadialProjection,
    largest_angle_rad,
)

# Of an OCam polynomial's inverse: 13 terms hold 5e-5 px for the paper's mirror, 6 lose 0.27 px.
INVERSE_TERMS = 14
MAX_INVERSE_PX = 0.05

_FIELD = "catoptra_picture"
_MARK = re.compile(rf'"?{_FIELD}"?\s*[:=]\s*"?(\w+)')


def mark_picture(text: str, picture: Picture) -> str:
    """Text of a file with the mark: a field of a JSON object, a comment of others."""
    if text.startswith("{"):
        # The last field: Basalt's reader takes the first one, whatever its name.
        return f'{text.rstrip()[:-1].rstrip()},\n  "{_FIELD}": "{picture.value}"\n}}\n'
    # At the end: OpenCV wants %YAML as the first bytes, OCamCalib one comment before each line.
    return f"{text}# {_FIELD}: {picture.value}\n"


def read_picture_mark(text: str, file: str) -> Picture | None:
    """Hand of the pictures that a file describes; None for files without a mark.

    Raises:
        ConfigError: The mark names no hand.
    """
    found = _MARK.search(text)
    if found is None:
        return None
    try:
        return Picture(found[1])
    except ValueError as error:
        names = " or ".join(picture.value for picture in Picture)
        raise file_error(file, _FIELD, names, value=found[1]) from error


def camera_from_numbers(
    lens: type[RadialProjection],
    numbers: Numbers,
    size_px: tuple[int, int],
    *,
    first_pixel: float = 0.0,
) -> OmniCamera:
    """Camera of a calibration, flipped, up to the largest angle that its image shows.

    Args:
        lens: Model of the lens.
        numbers: By canonical names: fields of the lens, of OCam's its polynomial as poly or as a0,
            a1, ..., negated as n0, n1, ..., of either sign as e0, e1, ...; fx, fy, cx, cy, skew,
            p1, p2; of a lens in pixels the matrix sxx, sxy, syx, syy from its plane to the image,
            and cx_offset, cy_offset from the image's middle. Limits: fov_deg; tan_limit, the
            tangent of an angle; radii circle_px and, in half heights, circle_share; mirror_mask,
            1 for MultiCol-SLAM's.
        size_px: Width and height.
        first_pixel: Coordinate of the first pixel's centre.

    Raises:
        DomainError: An impossible model, or a centre far outside the image.
    """
    get = numbers.get
    width, height = size_px
    fx: float = get("fx", 1.0)
    skew, fy = get("skew", fx * get("sxy", 0.0)), get("fy", fx * get("syy", 1.0))
    if not (fx > 0.0 and fy > 0.0):
        raise DomainError(f"focal lengths must be above 0: fx = {fx!r}, fy = {fy!r}")
    stretch = (get("sxx", 1.0), skew / fx, get("syx", 0.0), fy / fx)
    centre_px = (
        get("cx", 0.5 * width - 0.5 + get("cx_offset", 0.0)) + 0.5 - first_pixel,
        get("cy", 0.5 * height - 0.5 + get("cy_offset", 0.0)) + 0.5 - first_pixel,
    )
    plane = ImagePlane(stretch, get("p1", 0.0), get("p2", 0.0))
    camera = place_camera(_make_lens(lens, numbers), size_px, centre_px, fx, plane)
    limits = [camera.rim_rad, math.radians(0.5 * get("fov_deg", 360.0))]
    limits.append(math.atan(get("tan_limit", 0.0)) or math.pi)
    circles_px = (
        get("circle_px", 0.0), get("circle_share", 0.0) * (height // 2),
        # `CreateMirrorMask` of its cam_model_omni.cpp.
        get("mirror_mask", 0.0) and get("cy", 0.0) + 22.0,
    )  # fmt: skip
    limits += [largest_angle_rad(camera.projection, px / fx) for px in circles_px if px > 0.0]
    return replace(camera, rim_rad=min(limits))


def _make_lens(lens: type[RadialProjection], numbers: Numbers) -> RadialProjection:
    if lens is OCamLens:
        terms = numbers.get("poly") or _count_up(numbers, "a")
        terms = terms or tuple(-term for term in _count_up(numbers, "n")) or _count_up(numbers, "e")
        num_terms = numbers.get("num_poly", len(terms))
        if num_terms != len(terms) or len(terms) > _MAX_TERMS:
            raise DomainError(f"a polynomial of {num_terms:g} terms has {len(terms)}")
        is_turned = "e0" in numbers and terms[0] < 0.0
        return OCamLens(tuple(-term for term in terms) if is_turned else terms)
    parameters = {one.name: numbers[one.name] for one in fields(lens) if one.name in numbers}  # type: ignore[arg-type]
    if lens is UnifiedLens:
        parameters.setdefault("xi", 0.0)  # a pinhole camera
    return lens(**parameters)


def _count_up(numbers: Numbers, letter: str) -> tuple[float, ...]:
    """Numbers called by a letter and 0, 1, ..."""
    names = takewhile(numbers.__contains__, (f"{letter}{power}" for power in count()))
    return tuple(map(numbers.__getitem__, names))


def place_camera(
    projection: RadialProjection,
    size_px: tuple[int, int],
    centre_px: tuple[float, float],
    scale_px: float,
    plane: ImagePlane,
) -> OmniCamera:
    """Camera up to the angle of its farthest corner, or to the limit of its projection.

    Raises:
        DomainError: An impossible camera, or a centre farther off the image than its size.
    """
    width, height = size_px
    if not (-width <= centre_px[0] <= 2 * width and -height <= centre_px[1] <= 2 * height):
        raise DomainError(f"a centre at {centre_px} is far outside of {width} x {height} px")
    corner_px = max(
        math.hypot(u - centre_px[0], v - centre_px[1]) for u in (0, width) for v in (0, height)
    )
    ratio = corner_px / scale_px / plane.stretch_limits[0]
    rim_rad = largest_angle_rad(projection, ratio)
    if plane.is_decentred and isinstance(projection, DistortedProjection):
        rim_rad = min(rim_rad, decentred_fold_rad(projection, plane) * WITHIN_LIMIT)
    size_px = (width, height)
    return OmniCamera(
        projection, *size_px, centre_px, scale_px, rim_rad, 0.0, Picture.FLIPPED, plane
    )


# Of numbers that a format may leave out; all others are 0.
_DEFAULTS = {"beta": 1.0, "sxx": 1.0, "syy": 1.0}
_AFFINE = ("sxx", "sxy", "syx", "syy")
_MAX_TERMS = 64


def simplify_plane(camera: OmniCamera, names: Set[str]) -> OmniCamera:
    """The camera without what a format with these names has no place for in the image plane."""
    plane, (a, b, c, d) = camera.plane, camera.plane.stretch
    if not names & {"skew", "sxy"}:
        b = 0.0
    if "syx" not in names:
        c = 0.0
    if not names & {"fy", "sxx", "syy"}:
        a = d = math.sqrt(a * d)
    p1, p2 = (plane.p1, plane.p2) if "p1" in names else (0.0, 0.0)
    return replace(camera, plane=ImagePlane((a, b, c, d), p1, p2))


def numbers_from_camera(camera: OmniCamera, names: Set[str], first_pixel: float) -> Numbers:
    """Numbers of a camera for a file; those of `camera_from_numbers`, and inverses of OCam's.

    Args:
        camera: The camera.
        names: Names that the format has.
        first_pixel: Coordinate of the first pixel's centre.

    Raises:
        DomainError: The format has no place for a property of the camera.
    """
    flipped = camera.with_picture(Picture.FLIPPED)
    lens, stretch = camera.projection, camera.plane.stretch
    shape: Numbers = {"p1": camera.plane.p1, "p2": camera.plane.p2}
    if isinstance(lens, (OCamLens, WoodScapeLens)):
        # In pixels of this image, and with a 1 in the place of the matrix that the format lacks.
        unit = stretch[3] if "sxx" in names else stretch[0]
        shape |= zip(_AFFINE, (each / unit for each in stretch), strict=True)
        scale_px = camera.scale_px * unit
        if isinstance(lens, OCamLens):
            poly = tuple(a * scale_px ** (1 - power) for power, a in enumerate(lens.polynomial))
            letter = next((each for each in "ane" if f"{each}0" in names), "")
            sign = -1.0 if letter == "n" else 1.0
            shape |= {f"{letter}{power}": sign * a for power, a in enumerate(poly) if letter}
        else:
            shape |= {name: scale_px * k for name, k in _fields_of(lens).items()}
    else:
        fx, skew, syx, fy = (camera.scale_px * each for each in stretch)
        shape |= {"fx": fx, "skew": skew, "syx": syx, "fy": fy} | _fields_of(lens)
    for name, value in shape.items():
        if name not in names and value != _DEFAULTS.get(name, 0.0):
            raise DomainError(f"the format has no {name}, which is {value:.6g}")
    u, v = (each - 0.5 + first_pixel for each in flipped.centre_px)
    width, height = camera.width_px, camera.height_px
    shape |= {"width": width, "height": height, "cx": u, "cy": v}
    shape |= {"cx_offset": u - 0.5 * width + 0.5, "cy_offset": v - 0.5 * height + 0.5}
    shape |= {"fov_deg": math.degrees(2.0 * camera.rim_rad)}
    if isinstance(lens, OCamLens):
        shape |= {"poly": poly, "num_poly": len(poly)} | _invert(camera, unit, names)
    return shape


def _fields_of(lens: RadialProjection) -> Numbers:
    return {one.name: float(getattr(lens, one.name)) for one in fields(lens)}  # type: ignore[arg-type]


def _invert(camera: OmniCamera, stretch: float, names: Set[str]) -> Numbers:
    """Image radius as a polynomial of the angle from the image plane, backwards (inv) and forwards
    (fwd), and of the angle from the axis, highest power first (of_theta); least squares in px.

    Raises:
        DomainError: A polynomial of the format's length is off by too much.
    """
    theta = np.linspace(0.0, camera.rim_rad, 2001)
    radius = stretch * camera.radius_px_from_t(np.tan(0.5 * theta))
    inverses: Numbers = {}
    for name, angle in (
        ("inv", theta - 0.5 * math.pi),
        ("fwd", 0.5 * math.pi - theta),
        ("of_theta", theta),
    ):
        if not any(each.startswith(name) for each in names):
            continue
        length = next(n for n in count() if f"{name}{n}" not in names) or INVERSE_TERMS
        fit = np.polynomial.Polynomial.fit(angle, radius, length - 1)
        terms = tuple(fit.convert().coef.tolist())
        off_px = float(np.abs(np.polynomial.polynomial.polyval(angle, terms) - radius).max())
        if off_px > MAX_INVERSE_PX:
            raise DomainError(f"an inverse of {length} terms is off by up to {off_px:.3g} px")
        inverses[name] = terms[::-1] if name == "of_theta" else terms
        inverses[f"num_{name}"] = len(terms)
        inverses |= {f"{name}{power}": term for power, term in enumerate(terms)}
    return inverses
