"""A camera from the numbers of a calibration, and the mark of its pictures."""

from __future__ import annotations

import json
import math

import pytest

from catoptra_protocol.calibration.calibrated_camera import (
    Matrix,
    make_camera,
    mark_picture,
    matrix_from_camera,
    place_camera,
    read_picture_mark,
)
from catoptra_protocol.calibration.files import Fields
from catoptra_protocol.errors import ConfigError, DomainError
from catoptra_protocol.optics.image_plane import NO_CHANGE, ImagePlane
from catoptra_protocol.optics.lenses import EquidistantLens, KannalaBrandtLens, UnifiedLens
from catoptra_protocol.optics.radial_camera import Picture
from helpers.calibrated_cameras import PAPER

FIELDS = Fields("f", {})


def test_camera_ends_at_its_farthest_corner() -> None:
    matrix = Matrix(100.0, 100.0, 99.5, 49.5)
    camera = make_camera(FIELDS, EquidistantLens, matrix, (200, 120))
    assert camera.rim_rad == pytest.approx(math.hypot(100.0, 70.0) / 100.0)
    assert camera.centre_px == (100.0, 50.0)


def test_camera_ends_at_its_first_fold_where_that_is_nearer() -> None:
    lens = KannalaBrandtLens(-0.030687, -0.003343, -0.002882, -0.000592)
    camera = place_camera(lens, (960, 540), (480.0, 270.0), 200.0, NO_CHANGE)
    assert camera.rim_rad == pytest.approx(lens.fold_rad)
    decentred = ImagePlane(p1=1e-3, p2=-5e-4)
    back = UnifiedLens(1.19807, -0.25709, 0.01283)
    camera = place_camera(back, (2000, 2000), (1000.0, 1000.0), 620.3, decentred)
    assert math.degrees(camera.rim_rad) == pytest.approx(117.88, abs=0.01)


def test_matrix_is_of_the_flipped_picture() -> None:
    matrix = matrix_from_camera(PAPER, 100.0)
    assert (matrix.cx, matrix.cy, matrix.fx) == (179.5, 179.5, 100.0)
    assert PAPER.picture is Picture.MIRRORED
    plane = ImagePlane((1.0, 0.0, 0.1, 1.0))
    turned = place_camera(PAPER.projection, (9, 9), (4.0, 4.0), 1.0, plane)
    with pytest.raises(DomainError, match="below its diagonal"):
        matrix_from_camera(turned, 1.0)


def test_impossible_model_is_an_error_of_the_file() -> None:
    with pytest.raises(ConfigError, match=r"f: model=.*xi >= 0"):
        make_camera(FIELDS, lambda: UnifiedLens(-1.0), Matrix(1.0, 1.0, 2.0, 2.0), (4, 4))


TEXTS = ["%YAML:1.0\n---\nxi: 1.0\n", "cam0:\n  xi: 1.0\n", '{\n  "value0": {"a": 1}\n}\n']


@pytest.mark.parametrize("picture", list(Picture))
@pytest.mark.parametrize("text", TEXTS)
def test_mark_of_a_text_is_read_again(text: str, picture: Picture) -> None:
    marked = mark_picture(text, picture)
    assert read_picture_mark(marked, "file") is picture
    # The head stays first for OpenCV, the first object for Basalt.
    assert marked.splitlines()[0] in (text.splitlines()[0], f"# catoptra_picture: {picture.value}")
    if text.startswith("{"):
        assert list(json.loads(marked)) == ["value0", "catoptra_picture"]


def test_file_of_another_program_has_no_mark() -> None:
    assert read_picture_mark("cam0:\n  picture: nice\n", "file") is None


def test_mark_of_no_hand_is_an_error() -> None:
    with pytest.raises(
        ConfigError, match=r"a\.yaml.*catoptra_picture='upside'.*mirrored or flipped"
    ):
        read_picture_mark("# catoptra_picture: upside\n", "a.yaml")
