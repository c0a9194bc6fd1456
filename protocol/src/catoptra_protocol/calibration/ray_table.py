"""Ray table: the direction of every pixel, in a file of NumPy's arrays (.npz); cameras from it.

The truth that all models approximate, and the one form for a mirror without a single viewpoint.
Arrays: `direction` (h, w, 3) unit float64, `valid` (h, w) bool, `origin_m` (3,) zeros or (h, w, 3)
float64, of the pixels' centres; texts: `frame`, `picture`, `law`; `first_pixel`, the coordinate of
the first pixel's centre. Frame: x right, y down, z along the optical axis.

The camera of a central table has its centre, its stretch and a measured lens, by least squares.
With the optical axis given by the table's frame, a pixel is centre + M r(theta) (cos, sin): odd
polynomials of theta find the centre and the matrix M, hats between knots the rest of the radius.
"""

from __future__ import annotations

import io
import math
import struct
import tokenize
import warnings
import zipfile
import zlib
from pathlib import Path

import numpy as np
import numpy.typing as npt

from catoptra_protocol.calibration.calibrated_camera import place_camera
from catoptra_protocol.calibration.files import file_error
from catoptra_protocol.errors import ConfigError, DomainError
from catoptra_protocol.limits import MAX_IMAGE_SIDE_PX
from catoptra_protocol.optics.camera_rays import rays_from_pixel_grid
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import RadialTableLens
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.slotted_dataclass import dataclass

TABLE_NAME = "ray_table.npz"
FIELDS = "direction, valid, origin_m, first_pixel, frame, picture, law"
FRAME = "x right, y down, z along the optical axis"
_FIRST_BYTES = b"PK\x03\x04"
# Of an image of 2048 px; a file may claim any size.
_MAX_BYTES = 2**28
# Whatever is wrong with the form: archives, deflated data and NumPy raise any of these; of memory
# because an array's head may claim any shape, of a syntax because NumPy reads heads as Python.
_BAD_ARCHIVE = (
    *(OSError, ValueError, EOFError, KeyError, RuntimeError, NotImplementedError),
    *(MemoryError, OverflowError, zipfile.BadZipFile, zlib.error, struct.error),
    *(SyntaxError, TypeError, IndexError, tokenize.TokenError, UserWarning),
)
# Of all files: the same camera gives the same bytes.
_NO_DATE = (1980, 1, 1, 0, 0, 0)
_UNIT_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class PixelRays:
    """Rays of the pixels' centres of an image."""

    direction: Floats
    """(h, w, 3) unit, in the table's frame."""
    valid: Bools
    """(h, w)."""
    origin_m: Floats
    """(3,) of all rays, or (h, w, 3) of each."""
    picture: Picture
    """Hand of the pictures."""

    @property
    def is_central(self) -> bool:
        """Whether all rays begin at one point."""
        return self.origin_m.ndim == 1


def make_ray_table(camera: OmniCamera) -> PixelRays:
    """Table of a camera whose picture is flipped, or is to be taken for flipped."""
    u, v = (np.arange(side, dtype=np.float64) for side in (camera.width_px, camera.height_px))
    origin, direction, valid = rays_from_pixel_grid(camera, u + 0.5, v + 0.5)
    ca, sa = np.cos(camera.image_up_azimuth_rad), np.sin(camera.image_up_azimuth_rad)
    mirror_from_table = np.array([[-sa, -ca, 0.0], [ca, -sa, 0.0], [0.0, 0.0, 1.0]])
    origin_m = np.zeros(3) if origin is None else origin @ mirror_from_table
    return PixelRays(direction @ mirror_from_table, valid, origin_m, camera.picture)


def bytes_from_ray_table(table: PixelRays, *, law: str) -> bytes:
    """File of a table; the same bytes for the same table.

    Args:
        table: The table.
        law: The camera in words.
    """
    arrays: dict[str, npt.NDArray[np.generic]] = {
        "direction": np.ascontiguousarray(table.direction),
        "valid": table.valid,
        "origin_m": np.ascontiguousarray(table.origin_m),
        "first_pixel": np.array(0.5),
        "frame": np.array(FRAME),
        "picture": np.array(table.picture.value),
        "law": np.array(law),
    }
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as archive:
        for name, array in arrays.items():
            member = io.BytesIO()
            np.lib.format.write_array(member, array, allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", _NO_DATE)
            archive.writestr(info, member.getvalue(), zipfile.ZIP_DEFLATED, compresslevel=1)
    return data.getvalue()


def is_ray_table(path: Path) -> bool:
    """Whether a file begins as an archive of arrays."""
    with path.open("rb") as file:
        return file.read(len(_FIRST_BYTES)) == _FIRST_BYTES


def read_ray_table(path: Path | str) -> PixelRays:
    """Table of a file.

    Raises:
        ConfigError: No readable file, or an array that is missing, too large, of another shape, not
            finite or not of unit directions.
    """
    path = Path(path)
    arrays = _read_arrays(path)
    direction, valid, origin_m = (arrays.get(name) for name in ("direction", "valid", "origin_m"))
    if direction is None or direction.ndim != 3 or direction.shape[2] != 3:
        raise _make_error(path, "direction", direction, "an array of height x width x 3")
    size = direction.shape[:2]
    if not (1 <= min(size) and max(size) <= MAX_IMAGE_SIDE_PX):
        raise _make_error(path, "direction", direction, f"sides of 1 to {MAX_IMAGE_SIDE_PX}")
    if valid is None or valid.shape != size or valid.dtype != np.bool_:
        raise _make_error(path, "valid", valid, f"an array of {size[0]} x {size[1]} truth values")
    if origin_m is None or origin_m.shape not in ((3,), direction.shape):
        raise _make_error(path, "origin_m", origin_m, "3 numbers, or as many as directions")
    for name, array in (("direction", direction), ("origin_m", origin_m)):
        if array.dtype != np.float64 or not np.isfinite(array).all():
            raise _make_error(path, name, array, "finite numbers in double precision")
    with np.errstate(over="ignore"):  # an infinite length is none of a unit
        length = np.linalg.norm(direction[valid], axis=-1)
    if not valid.any() or np.abs(length - 1.0).max() > _UNIT_TOLERANCE:
        raise _make_error(path, "direction", direction, "unit directions where valid")
    if "first_pixel" in arrays and arrays["first_pixel"].tolist() != 0.5:
        raise _make_error(path, "first_pixel", arrays["first_pixel"], "0.5")
    picture = str(arrays.get("picture", np.array(Picture.FLIPPED.value)))
    if picture not in list(Picture):
        raise _make_error(path, "picture", arrays["picture"], " or ".join(Picture))
    return PixelRays(
        direction.astype(np.float64),
        valid.astype(np.bool_),
        origin_m.astype(np.float64),
        Picture(picture),
    )


def _read_arrays(path: Path) -> dict[str, npt.NDArray[np.generic]]:
    arrays, left = {}, _MAX_BYTES
    try:
        with zipfile.ZipFile(path) as archive:
            for name in FIELDS.split(", "):
                if f"{name}.npy" not in archive.namelist():
                    continue
                with archive.open(f"{name}.npy") as member:
                    # One more than allowed: the size that an archive states may be a lie.
                    data = member.read(left + 1)
                left -= len(data)
                if left < 0:
                    raise ValueError(f"its arrays are larger than {_MAX_BYTES} bytes")
                # A header of Python 2 is read with a warning: what wrote it, wrote no ray table.
                with warnings.catch_warnings():
                    warnings.simplefilter("error", UserWarning)
                    arrays[name] = np.load(io.BytesIO(data), allow_pickle=False)
    except _BAD_ARCHIVE as error:
        raise file_error(str(path), "file", f"a ray table: {error}") from error
    return arrays


def _make_error(
    path: Path, key: str, array: npt.NDArray[np.generic] | None, expected: str
) -> ConfigError:
    value = "missing" if array is None else f"{array.dtype} of shape {array.shape}"
    return file_error(str(path), key, expected, value=value)


_MAX_RESIDUAL_PX = 0.05
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
    if not off_px.max(initial=0.0) <= _MAX_RESIDUAL_PX:
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
