"""Ray table: the direction of every pixel, in a file of NumPy's arrays (.npz), for any camera.

The truth that all models approximate, and the one form for a mirror without a single viewpoint.
Arrays: `direction` (h, w, 3) unit float64, `valid` (h, w) bool, `origin_m` (3,) zeros or (h, w, 3)
float64, of the pixels' centres; texts: `frame`, `picture`, `law`; `first_pixel`, the coordinate of
the first pixel's centre. Frame: x right, y down, z along the optical axis.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.limits import MAX_IMAGE_SIDE_PX
from catoptra_protocol.optics.camera_rays import rays_from_pixel_grid
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.picture import Picture
from catoptra_protocol.slotted_dataclass import dataclass

TABLE_NAME = "ray_table.npz"
FIELDS = "direction, valid, origin_m, first_pixel, frame, picture, law"
FRAME = "x right, y down, z along the optical axis"
_FIRST_BYTES = b"PK\x03\x04"
# Of an image of 2048 px; a file may claim any size.
_MAX_BYTES = 2**28
# Whatever is wrong with the form: archives, deflated data and NumPy raise any of these; of memory
# because an array's head may claim any shape.
_BAD_ARCHIVE = (
    *(OSError, ValueError, EOFError, KeyError, RuntimeError, NotImplementedError),
    *(MemoryError, OverflowError, zipfile.BadZipFile, zlib.error, struct.error),
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
                arrays[name] = np.load(io.BytesIO(data), allow_pickle=False)
    except _BAD_ARCHIVE as error:
        raise ConfigError(
            SourceLocation(str(path)), key="file", value="", expected=f"a ray table: {error}"
        ) from error
    return arrays


def _make_error(
    path: Path, key: str, array: npt.NDArray[np.generic] | None, expected: str
) -> ConfigError:
    value = "missing" if array is None else f"{array.dtype} of shape {array.shape}"
    return ConfigError(SourceLocation(str(path)), key=key, value=value, expected=expected)
