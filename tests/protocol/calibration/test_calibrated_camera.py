"""A camera from the numbers of a calibration, and the mark of its pictures."""

from __future__ import annotations

import json
import math

import pytest

from catoptra_protocol.calibration.calibrated_camera import (
    camera_from_numbers,
    mark_picture,
    numbers_from_camera,
    place_camera,
    read_picture_mark,
    simplify_plane,
)
from catoptra_protocol.calibration.model_fits import compute_residual
from catoptra_protocol.errors import ConfigError, DomainError
from catoptra_protocol.optics.image_plane import NO_CHANGE, ImagePlane
from catoptra_protocol.optics.lenses import EquidistantLens, KannalaBrandtLens, UnifiedLens
from catoptra_protocol.optics.radial_camera import Picture
from helpers.calibrated_cameras import THETA_BACK

NAMES = {"fx", "fy", "xi", "k1", "k2", "p1", "p2"}
MATRIX = {"fx": 100.0, "fy": 100.0, "cx": 99.5, "cy": 49.5}


def test_camera_ends_at_its_farthest_corner_or_at_a_stated_limit() -> None:
    camera = camera_from_numbers(EquidistantLens, MATRIX, (200, 120))
    assert camera.rim_rad == pytest.approx(math.hypot(100.0, 70.0) / 100.0)
    assert camera.centre_px == (100.0, 50.0)
    for limit, rim_rad in (
        ({"fov_deg": 90.0}, 0.25 * math.pi),
        ({"tan_limit": 1.0}, 0.25 * math.pi),
        ({"circle_share": 0.5}, 0.3),
    ):
        limited = camera_from_numbers(EquidistantLens, MATRIX | limit, (200, 120))
        assert limited.rim_rad == pytest.approx(rim_rad)


def test_camera_ends_at_its_first_fold_where_that_is_nearer() -> None:
    lens = KannalaBrandtLens(-0.030687, -0.003343, -0.002882, -0.000592)
    camera = place_camera(lens, (960, 540), (480.0, 270.0), 200.0, NO_CHANGE)
    assert camera.rim_rad == pytest.approx(lens.fold_rad)
    decentred = ImagePlane(p1=1e-3, p2=-5e-4)
    back = UnifiedLens(1.19807, -0.25709, 0.01283)
    camera = place_camera(back, (2000, 2000), (1000.0, 1000.0), 620.3, decentred)
    assert math.degrees(camera.rim_rad) == pytest.approx(117.88, abs=0.01)


def test_numbers_are_of_the_flipped_picture_and_lead_back() -> None:
    numbers = numbers_from_camera(THETA_BACK.with_picture(Picture.MIRRORED), NAMES | {"skew"}, 0.5)
    assert (numbers["cx"], numbers["cy"], numbers["fx"]) == (480.0, 540.0, 620.3)
    back = camera_from_numbers(UnifiedLens, numbers, (960, 1080), first_pixel=0.5)
    assert compute_residual(THETA_BACK, back).max_px < 1e-9


def test_property_without_a_place_is_left_out_or_an_error() -> None:
    with pytest.raises(DomainError, match=r"no skew, which is 1\.24"):
        numbers_from_camera(THETA_BACK, NAMES, 0.0)
    assert simplify_plane(THETA_BACK, {"fy"}).plane == ImagePlane((1.0, 0.0, 0.0, 1.01))
    assert simplify_plane(THETA_BACK, {"p1"}).plane.stretch[0] == pytest.approx(1.01**0.5)


TEXTS = ["%YAML:1.0\n---\nxi: 1.0\n", "cam0:\n  xi: 1.0\n", '{\n  "value0": {"a": 1}\n}\n']


@pytest.mark.parametrize("picture", list(Picture))
@pytest.mark.parametrize("text", TEXTS)
def test_mark_of_a_text_is_read_again(text: str, picture: Picture) -> None:
    marked = mark_picture(text, picture)
    assert read_picture_mark(marked, "file") is picture
    # The head stays first for OpenCV, the first object for Basalt.
    assert marked.splitlines()[0] == text.splitlines()[0]
    if text.startswith("{"):
        assert list(json.loads(marked)) == ["value0", "catoptra_picture"]


def test_file_of_another_program_has_no_mark() -> None:
    assert read_picture_mark("cam0:\n  picture: nice\n", "file") is None


def test_mark_of_no_hand_is_an_error() -> None:
    with pytest.raises(
        ConfigError, match=r"a\.yaml.*catoptra_picture='upside'.*mirrored or flipped"
    ):
        read_picture_mark("# catoptra_picture: upside\n", "a.yaml")
