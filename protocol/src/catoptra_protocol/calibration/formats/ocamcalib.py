"""OCamCalib's text file (calib_results.txt): a polynomial of the image radius and its inverse.

Law: the ray of an image point is (x, y, a0 + a2 rho^2 + ...), x along the rows downwards, y along
the columns to the right, z away from the scene, so a0 < 0. Image: row = c x + d y + xc, column =
e x + y + yc, first pixel 0. Source: Scaramuzza's toolbox, ocam_functions.cpp; both polynomials are
needed by its readers: from the image and, by the angle atan(z / rho), to the image.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.calibration.calibrated_camera import place_camera
from catoptra_protocol.calibration.calibration_format import Conventions
from catoptra_protocol.calibration.files import Fields, file_error
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import OCamLens
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture

NAME = "ocamcalib"
CONVENTIONS = Conventions(
    frame="x down, y right, z backward: a0 < 0",
    first_pixel=0.0,
    fields="N a0 .. aN-1; M inverse polynomial; row column; c d e; height width",
)

# Terms of the inverse: 13 hold 5e-5 px for the paper's mirror, where 6 lose 0.27 px.
_INVERSE_TERMS = 14
_MAX_TERMS = 64


def is_format(text: str) -> bool:
    """A text of comments and lines of numbers."""
    lines = _number_lines(text)
    return len(lines) == 5 and all(all(_is_number(word) for word in line) for line in lines)


def _number_lines(text: str) -> list[list[str]]:
    return [line.split() for line in text.splitlines() if line.strip() and line.strip()[0] != "#"]


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def read(text: str, file: str, camera: str) -> OmniCamera:
    """Camera of a file."""
    del camera  # a file has one
    lines = _number_lines(text)
    if len(lines) != 5:
        expected = "five lines of numbers: polynomial, inverse, centre, affine, size"
        raise file_error(file, "lines", expected, value=str(len(lines)))
    names = ("polynomial", "inverse", "centre", "affine", "size")
    values = {
        name: [float(word) if _is_number(word) else word for word in line]
        for name, line in zip(names, lines, strict=True)
    }
    fields = Fields(file, values)
    forward = _read_polynomial(fields, "polynomial")
    _read_polynomial(fields, "inverse")
    row, column = fields.get_numbers("centre", 2)
    c, d, e = fields.get_numbers("affine", 3)
    height, width = fields.get_size_px("size")
    try:
        lens = OCamLens(tuple(-a for a in forward))
        # Right and down of the image from right (their y) and down (their x) of the plane.
        plane = ImagePlane((1.0, e, d, c))
        return place_camera(lens, (width, height), (column + 0.5, row + 0.5), 1.0, plane)
    except DomainError as error:
        raise fields.make_error("polynomial", f"a possible camera: {error}") from error


def _read_polynomial(fields: Fields, name: str) -> tuple[float, ...]:
    count, *terms = fields.get_numbers(name)
    if count != len(terms) or not 1 <= len(terms) <= _MAX_TERMS:
        raise fields.make_error(name, "the number of terms, then as many terms")
    return tuple(terms)


def write(camera: OmniCamera, name: str) -> str:
    """Text of a file."""
    lens = camera.projection
    if not isinstance(lens, OCamLens):
        raise DomainError(f"{type(lens).__name__} is no polynomial of rays")
    if camera.plane.is_decentred:
        raise DomainError("OCamCalib has no tangential distortion")
    a, b, c, d = camera.plane.stretch
    u, v = camera.with_picture(Picture.FLIPPED).centre_px
    # In pixels of this image: with rho = r / scale the height is scale times the polynomial. Their
    # affine matrix has a 1 for the columns; the scale of the columns goes into the polynomial.
    scale_px = camera.scale_px * a
    terms = [
        -coefficient * scale_px ** (1 - power) for power, coefficient in enumerate(lens.polynomial)
    ]
    inverse = _inverse_terms(camera, scale_px / camera.scale_px)
    return "\n".join(
        (
            f"# {name}: polynomial of the ray's height, first the number of terms",
            _format_line((len(terms), *terms)),
            "# polynomial of the image radius by atan(z / rho)",
            _format_line((len(inverse), *inverse)),
            "# centre: row and column, first pixel 0",
            _format_line((v - 0.5, u - 0.5)),
            "# affine parameters c, d, e",
            _format_line((d / a, c / a, b / a)),
            "# size: height and width",
            f"{camera.height_px} {camera.width_px}",
            "",
        )
    )


def _inverse_terms(camera: OmniCamera, stretch: float) -> tuple[float, ...]:
    """Image radius as a polynomial of the elevation above the image plane, least squares in px."""
    theta = np.linspace(0.0, camera.rim_rad, 2001)
    radius = stretch * camera.radius_px_from_t(np.tan(0.5 * theta))
    fit = np.polynomial.Polynomial.fit(theta - 0.5 * math.pi, radius, _INVERSE_TERMS - 1)
    return tuple(fit.convert().coef.tolist())


def _format_line(numbers: tuple[float, ...]) -> str:
    return " ".join(str(n) if isinstance(n, int) else repr(float(n)) for n in numbers)
