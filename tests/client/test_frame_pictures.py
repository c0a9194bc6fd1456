"""Panoramas, image files and views of frames for notebooks."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import catoptra_client
from catoptra_client.frame import Frame, Pixels, rgb_from_image_bytes
from catoptra_client.frame_pictures import choose_cylinder, make_panorama, write_image
from catoptra_protocol.errors import CatoptraError, DomainError
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors.hyperbolic import HyperbolicMirror
from catoptra_protocol.optics.omni_camera import (
    OmniCamera,
    camera_with_inscribed_rim,
    direction_from_pixel,
)
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.usarsim.image_port import ImageType

PERSPECTIVE = PerspectiveCamera(40, 30, 1.0)


def make_camera(rim_deg: float = 120.0) -> OmniCamera:
    """Camera of 360 x 360 px."""
    return camera_with_inscribed_rim(
        HyperbolicMirror(11.546, 2.321), width_px=360, height_px=360, rim_rad=math.radians(rim_deg)
    )


def make_frame(rgb: Pixels, camera: OmniCamera | PerspectiveCamera | None) -> Frame:
    return Frame(rgb, 1, 0.0, ImageType.RAW, camera=camera)


def paint_directions(camera: OmniCamera) -> Pixels:
    """Image that is bright to the right of the robot, and dark elsewhere."""
    directions, valid = direction_from_pixel(camera, pixel_sample_positions(camera)[:, :, 0])
    is_right = valid & (directions[..., 1] > np.abs(directions[..., 0]))
    return np.repeat(np.uint8(200) * is_right[..., None].astype(np.uint8), 3, axis=-1)


def test_panorama_shows_the_right_side_right_of_the_middle() -> None:
    camera = make_camera()
    panorama = make_panorama(make_frame(paint_directions(camera), camera), columns=400)
    bright = panorama[10:-10, :, 0] > 100
    columns = np.flatnonzero(bright.mean(axis=0) > 0.5)
    # From 45 to 135 degrees of azimuth, ahead being column 200.
    assert (columns.min(), columns.max()) == pytest.approx((250, 349), abs=1)


@pytest.mark.parametrize("rim_deg", [30.0, 60.0, 90.0, 120.0, 150.0])
def test_panorama_of_any_rim_has_square_pixels_and_shows_something(rim_deg: float) -> None:
    camera = make_camera(rim_deg)
    cylinder = choose_cylinder(camera, 720)
    assert cylinder.slope_per_row == pytest.approx(cylinder.azimuth_per_column_rad, rel=0.01)
    frame = make_frame(np.full((360, 360, 3), 255, np.uint8), camera)
    assert make_panorama(frame, columns=720).mean() > 200


@pytest.mark.parametrize("camera", [None, PERSPECTIVE])
def test_panorama_without_an_omnidirectional_camera_is_refused(
    camera: PerspectiveCamera | None,
) -> None:
    with pytest.raises(DomainError, match="model of an omnidirectional camera"):
        make_panorama(make_frame(np.zeros((30, 40, 3), np.uint8), camera))


@pytest.mark.parametrize("name", ["a.png", "b.JPG", "c.jpeg"])
def test_image_file_holds_the_pixels(name: str, tmp_path: Path) -> None:
    rgb = np.zeros((16, 24, 3), np.uint8)
    rgb[..., 0] = 250
    write_image(tmp_path / name, rgb)
    read = rgb_from_image_bytes((tmp_path / name).read_bytes())
    assert read.shape == rgb.shape
    assert np.abs(read.astype(int) - rgb).max() <= 4


def test_image_file_of_another_format_is_refused_before_it_exists(tmp_path: Path) -> None:
    path = tmp_path / "a.tiff"
    with pytest.raises(CatoptraError, match=r"a\.tiff: .* ends with one of \.png, \.jpg"):
        write_image(path, np.zeros((2, 2, 3), np.uint8))
    assert not path.exists()


def test_image_file_without_pixels_is_refused_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(CatoptraError, match="spawn a robot with a camera first"):
        write_image(tmp_path / "a.png", np.zeros((0, 0, 3), np.uint8))


def test_view_in_a_notebook_shows_picture_above_panorama() -> None:
    camera = make_camera()
    frame = make_frame(np.full((360, 360, 3), 77, np.uint8), camera)
    view = catoptra_client.show(frame)
    assert view.panorama is not None
    shown = rgb_from_image_bytes(view._repr_png_())
    assert shown.shape == (360 + view.panorama.shape[0], view.panorama.shape[1], 3)
    np.testing.assert_array_equal(shown[360:], view.panorama)
    middle = (view.panorama.shape[1] - 360) // 2
    np.testing.assert_array_equal(shown[:360, middle : middle + 360], frame.rgb)
    assert not shown[:360, :middle].any()


@pytest.mark.parametrize("camera", [None, PERSPECTIVE])
def test_view_of_another_camera_is_the_picture(camera: PerspectiveCamera | None) -> None:
    frame = make_frame(np.full((30, 40, 3), 9, np.uint8), camera)
    view = catoptra_client.show(frame)
    assert view.panorama is None
    np.testing.assert_array_equal(rgb_from_image_bytes(view._repr_png_()), frame.rgb)
