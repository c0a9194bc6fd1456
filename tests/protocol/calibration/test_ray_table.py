"""Ray tables: the camera's own rays, exactly, in a file that is the same each time."""

from __future__ import annotations

import io
import math
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration.ray_table import (
    PixelRays,
    bytes_from_ray_table,
    is_ray_table,
    make_ray_table,
    read_ray_table,
)
from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.mirrors import SphericalMirror
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim
from catoptra_protocol.optics.picture import Picture
from helpers.calibrated_cameras import PAPER, TUM_VI

FLIPPED = PAPER.with_picture(Picture.FLIPPED)
BALL = camera_with_inscribed_rim(
    SphericalMirror(0.03, 0.2),
    width_px=60,
    height_px=60,
    rim_rad=math.radians(120.0),
    picture=Picture.FLIPPED,
)


def write(table: PixelRays, path: Path) -> Path:
    path.write_bytes(bytes_from_ray_table(table, law="test"))
    return path


def test_rays_are_those_of_the_published_formula() -> None:
    table = make_ray_table(FLIPPED)
    row, column = np.nonzero(table.valid)
    x, y, z = table.direction[table.valid].T
    xi, gamma = 0.9954941783139403, 102.98653100332052
    assert gamma * x / (z + xi) + 179.5 == pytest.approx(column, abs=1e-9)
    assert gamma * y / (z + xi) + 179.5 == pytest.approx(row, abs=1e-9)
    assert table.is_central


@pytest.mark.parametrize("camera", [FLIPPED, TUM_VI, BALL], ids=["paper", "lens", "ball"])
def test_file_holds_every_bit_and_is_the_same_each_time(camera, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    table = make_ray_table(camera)
    path = write(table, tmp_path / "a.npz")
    assert is_ray_table(path)
    again = read_ray_table(path)
    np.testing.assert_array_equal(again.direction, table.direction)
    np.testing.assert_array_equal(again.valid, table.valid)
    np.testing.assert_array_equal(again.origin_m, table.origin_m)
    assert again.picture is table.picture
    assert again.is_central == (camera is not BALL)
    assert path.read_bytes() == write(table, tmp_path / "b.npz").read_bytes()


@pytest.mark.parametrize(
    ("name", "array", "message"),
    [
        ("direction", np.zeros((4, 4)), "height x width x 3"),
        ("direction", None, "direction='missing'"),
        ("direction", np.full((60, 60, 3), math.nan), "finite numbers"),
        ("direction", np.full((60, 60, 3), 2.0), "unit directions"),
        ("valid", np.ones((3, 3), dtype=bool), "60 x 60 truth values"),
        ("valid", np.zeros((60, 60), dtype=bool), "unit directions where valid"),
        ("origin_m", np.zeros(2), "3 numbers"),
        ("first_pixel", np.array(0.0), "0.5"),
        ("picture", np.array("upside"), "mirrored or flipped"),
    ],
)
def test_wrong_array_is_named_with_what_was_expected(
    name: str, array: np.ndarray | None, message: str, tmp_path: Path
) -> None:
    content = dict(np.load(io.BytesIO(bytes_from_ray_table(make_ray_table(BALL), law="x"))))
    content[name] = array
    path = tmp_path / "table.npz"
    np.savez(path, **{key: value for key, value in content.items() if value is not None})
    with pytest.raises(ConfigError, match=message) as raised:
        read_ray_table(path)
    assert "table.npz" in str(raised.value)


@pytest.mark.parametrize("data", [b"PK\x03\x04", b"PK\x03\x04" + b"\0" * 200, b""])
def test_damaged_file_is_no_table(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "table.npz"
    path.write_bytes(data)
    with pytest.raises(ConfigError, match="a ray table"):
        read_ray_table(path)


def test_array_that_swells_is_refused_and_pickles_are_not_loaded(tmp_path: Path) -> None:
    path = tmp_path / "table.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("direction.npy", b"\0" * (2**27 + 1))
    with pytest.raises(ConfigError, match="larger than"):
        read_ray_table(path)
    np.savez(path, direction=np.array([{}], dtype=object))
    with pytest.raises(ConfigError, match="pickle"):
        read_ray_table(path)


def test_mirrored_table_says_so(tmp_path: Path) -> None:
    table = replace(make_ray_table(FLIPPED), picture=Picture.MIRRORED)
    assert read_ray_table(write(table, tmp_path / "t.npz")).picture is Picture.MIRRORED
