"""Tables of rays: their files, and lenses fitted to them."""

from __future__ import annotations

import io
import math
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration import ray_table
from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.calibration_folder import write_calibration
from catoptra_protocol.calibration.model_fits import compute_residual
from catoptra_protocol.calibration.ray_table import (
    PixelRays,
    bytes_from_ray_table,
    fit_table,
    is_ray_table,
    make_ray_table,
    read_ray_table,
)
from catoptra_protocol.errors import ConfigError, DomainError
from catoptra_protocol.optics.lenses import RadialTableLens
from catoptra_protocol.optics.mirrors import SphericalMirror
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture
from helpers.calibrated_cameras import PAPER, THETA_BACK, TUM_VI, TUM_VI_KB

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
def test_file_holds_every_bit_and_is_the_same_each_time(camera: OmniCamera, tmp_path: Path) -> None:
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
        ("direction", np.full((60, 60, 3), 1e200), "unit directions"),
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


def test_arrays_that_swell_are_refused_and_pickles_are_not_loaded(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = write(make_ray_table(BALL), tmp_path / "table.npz")
    # The directions alone are larger, and all arrays together count.
    for limit in (2**14, 100_000):
        monkeypatch.setattr(ray_table, "_MAX_BYTES", limit)
        with pytest.raises(ConfigError, match=f"larger than {limit} bytes"):
            read_ray_table(path)
    monkeypatch.undo()
    np.savez(path, direction=np.array([{}], dtype=object))
    with pytest.raises(ConfigError, match="pickle"):
        read_ray_table(path)


def test_array_whose_head_claims_more_or_is_no_python_is_refused(tmp_path: Path) -> None:
    member = io.BytesIO()
    np.lib.format.write_array(member, np.zeros((2, 2, 3)))
    for side in (b"90000000, 20000", b"9" * 30 + b", 2", b"(", b"\0"):
        data = member.getvalue().replace(b"(2, 2, 3), }", b"(" + side + b", 3), }")
        path = tmp_path / "table.npz"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("direction.npy", data)
        with pytest.raises(ConfigError, match="a ray table"):
            read_ray_table(path)


def test_table_with_a_wrong_byte_anywhere_is_an_error_or_a_table(tmp_path: Path) -> None:
    data = bytearray(bytes_from_ray_table(make_ray_table(BALL), law="test"))
    path = tmp_path / "table.npz"
    rng = np.random.default_rng(1)
    num_refused = 0
    for at in rng.integers(0, len(data), 300):
        damaged = data.copy()
        damaged[at] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged)
        try:
            read_ray_table(path)
        except ConfigError:
            num_refused += 1
    # The archive has a checksum of each array.
    assert num_refused > 280


def test_mirrored_table_says_so(tmp_path: Path) -> None:
    table = replace(make_ray_table(FLIPPED), picture=Picture.MIRRORED)
    assert read_ray_table(write(table, tmp_path / "t.npz")).picture is Picture.MIRRORED


@pytest.mark.parametrize(
    ("camera", "max_px"),
    [(FLIPPED, 1e-4), (TUM_VI, 1e-5), (TUM_VI_KB, 1e-6)],
    ids=["paper", "ds", "kb"],
)
def test_camera_of_a_table_is_the_camera(camera: OmniCamera, max_px: float) -> None:
    found = fit_table(make_ray_table(camera))
    assert isinstance(found.projection, RadialTableLens)
    assert found.centre_px == pytest.approx(camera.centre_px, abs=1e-4)
    assert found.plane.stretch == pytest.approx(camera.plane.stretch, abs=1e-6)
    residual = compute_residual(camera, found)
    assert residual.max_px < max_px
    # The outermost ring of pixels lies beyond the last centre.
    assert residual.fraction_missing < 0.02


@pytest.mark.parametrize("picture", list(Picture))
def test_exported_table_is_read_as_the_camera_of_its_pictures(
    picture: Picture, tmp_path: Path
) -> None:
    write_calibration(PAPER, tmp_path, name="cam", picture=picture)
    back = camera_from_file(tmp_path / "ray_table.npz")
    assert back.picture is picture
    assert compute_residual(PAPER, back).max_px < 1e-4
    other = next(one for one in Picture if one is not picture)
    with pytest.raises(ConfigError, match=f"a file of {other.value} pictures"):
        camera_from_file(tmp_path / "ray_table.npz", picture=other)


def test_rays_of_no_radial_lens_are_refused_with_the_number() -> None:
    # Tangential distortion of a published fish-eye: 2 px.
    with pytest.raises(DomainError, match=r"off its rays by up to 1\.\d+ px"):
        fit_table(make_ray_table(THETA_BACK))


def test_rays_without_a_common_origin_are_refused(tmp_path: Path) -> None:
    ball = camera_with_inscribed_rim(
        SphericalMirror(0.03, 0.2),
        width_px=60,
        height_px=60,
        rim_rad=math.radians(120.0),
        picture=Picture.FLIPPED,
    )
    write_calibration(ball, tmp_path, name="ball")
    with pytest.raises(ConfigError, match="do not begin at one point"):
        camera_from_file(tmp_path / "ray_table.npz")


def test_rays_at_random_are_refused() -> None:
    direction = np.random.default_rng(1).normal(size=(20, 20, 3))
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    table = PixelRays(direction, np.ones((20, 20), dtype=bool), np.zeros(3), Picture.FLIPPED)
    with pytest.raises(DomainError):
        fit_table(table)


def test_rays_that_show_no_lens_are_refused() -> None:
    whole = make_ray_table(FLIPPED)
    few = np.zeros_like(whole.valid)
    few[180, 100:150] = True
    with pytest.raises(DomainError, match="50 rays are too few"):
        fit_table(PixelRays(whole.direction, few, whole.origin_m, Picture.FLIPPED))
    along_axis = np.broadcast_to((0.0, 0.0, 1.0), whole.direction.shape)
    with pytest.raises(DomainError, match="within 0 deg of the axis"):
        fit_table(PixelRays(along_axis, whole.valid, whole.origin_m, Picture.FLIPPED))
