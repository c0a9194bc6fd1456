"""A camera from a ray table: centre, stretch and a measured lens, by least squares.

With the optical axis given by the table's frame, a pixel is centre + M r(theta) (cos, sin): odd
polynomials of theta find the centre and the matrix M, hats between knots the rest of the radius.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.calibration.calibrated_camera import place_camera
from catoptra_protocol.calibration.ray_table import PixelRays
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import RadialTableLens
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera

MAX_RESIDUAL_PX = 0.05
"""Largest residual of a camera from a table."""
_NUM_POWERS, _NUM_KNOTS = 9, 129
_MIN_PIXELS, _MAX_PIXELS = 1000, 200_000
# Of the rays' largest angle from the axis: a smaller one shows no lens.
_MIN_ANGLE_RAD = math.radians(1.0)


def fit_table(table: PixelRays) -> OmniCamera:
    """Camera of a central table, its picture taken for flipped.

    Raises:
        DomainError: The rays have no common origin, or no camera of a radial lens has them.
    """
    if not table.is_central:
        raise DomainError("its rays do not begin at one point: a section of a mirror describes it")
    row, column = np.nonzero(table.valid)
    if len(row) < _MIN_PIXELS:
        raise DomainError(f"{len(row)} rays are too few for a lens: {_MIN_PIXELS} at least")
    step = -(-len(row) // _MAX_PIXELS)
    row, column = row[::step], column[::step]
    x, y, z = table.direction[row, column].T
    rho = np.hypot(x, y)
    theta = np.arctan2(rho, z)
    last = float(theta.max())
    if last < _MIN_ANGLE_RAD:
        raise DomainError(f"all of its rays are within {math.degrees(last):.3g} deg of the axis")
    safe = np.where(rho > 0.0, rho, 1.0)
    cosine, sine = np.where(rho > 0.0, x / safe, 0.0), np.where(rho > 0.0, y / safe, 0.0)
    u, v = column.astype(np.float64) + 0.5, row.astype(np.float64) + 0.5
    centre, plane, terms = _solve_plane(theta, (cosine, sine), (u, v))
    du, dv = plane.undo_stretch(u - centre[0], v - centre[1])
    # Along the ray's own azimuth: what is left across it is residual.
    radius = du * cosine + dv * sine
    knots = np.linspace(0.0, last, _NUM_KNOTS)
    rest = _fit_hats(theta / last * (_NUM_KNOTS - 1), radius - _odd(theta, terms))
    radii = _odd(knots, terms) + rest
    lens = RadialTableLens(tuple(np.degrees(knots).tolist()), (0.0, *radii[1:].tolist()))
    camera = place_camera(lens, (table.valid.shape[1], table.valid.shape[0]), centre, 1.0, plane)
    found, _ = camera.pixel_from_direction(np.stack((x, y, z), axis=-1) @ _MIRROR_FROM_TABLE.T)
    off_px = np.hypot(found[:, 0] - u, found[:, 1] - v)[theta < camera.rim_rad]
    if not off_px.max(initial=0.0) <= MAX_RESIDUAL_PX:
        raise DomainError(f"a radial lens is off its rays by up to {off_px.max():.3g} px")
    return camera


# Axes of the table in the mirror frame of a camera whose image's top is +x.
_MIRROR_FROM_TABLE = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def _odd(theta: Floats, terms: Floats) -> Floats:
    """Odd polynomial of angles."""
    powers = 2 * np.arange(len(terms)) + 1
    values: Floats = (theta[:, None] / math.pi) ** powers @ terms
    return values


def _solve_plane(
    theta: Floats, azimuth: tuple[Floats, Floats], pixels: tuple[Floats, Floats]
) -> tuple[tuple[float, float], ImagePlane, Floats]:
    """Centre, stretch, and the odd polynomial of the radius along the columns."""
    cosine, sine = azimuth
    basis = (theta[:, None] / math.pi) ** (2 * np.arange(_NUM_POWERS) + 1)
    ones = np.ones((len(theta), 1))
    columns = np.concatenate((ones, basis * cosine[:, None], basis * sine[:, None]), axis=1)
    size = np.linalg.norm(columns, axis=0)
    both = np.linalg.lstsq(columns / size, np.stack(pixels, axis=-1), rcond=None)[0] / size[:, None]
    along_u, along_v = both[:, 0], both[:, 1]
    terms = along_u[1 : _NUM_POWERS + 1]
    whole = basis @ terms
    power = float(whole @ whole)
    skew = float(whole @ (basis @ along_u[_NUM_POWERS + 1 :])) / power
    turn = float(whole @ (basis @ along_v[1 : _NUM_POWERS + 1])) / power
    aspect = float(whole @ (basis @ along_v[_NUM_POWERS + 1 :])) / power
    return (float(along_u[0]), float(along_v[0])), ImagePlane((1.0, skew, turn, aspect)), terms


def _fit_hats(places: Floats, values: Floats) -> Floats:
    """Values at whole places, of a piecewise linear function nearest to the given ones."""
    first = np.minimum(places.astype(np.intp), _NUM_KNOTS - 2)
    after = places - first
    normal = np.zeros((_NUM_KNOTS, _NUM_KNOTS))
    right = np.zeros(_NUM_KNOTS)
    for one, weight in ((first, 1.0 - after), (first + 1, after)):
        np.add.at(right, one, weight * values)
        for other, factor in ((first, 1.0 - after), (first + 1, after)):
            np.add.at(normal, (one, other), weight * factor)
    # Knots between which no pixel lies stay as the polynomial has them.
    damped = normal + 1e-9 * len(places) * np.eye(_NUM_KNOTS)
    return np.linalg.solve(damped, right).astype(np.float64)
