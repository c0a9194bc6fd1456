"""SET Viewports: cameras by viewport, missing cameras, unknown divisions."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_protocol.usarsim.commands import SetViewports
from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.frames.frame import crop
from catoptra_server.frames.multi_view import (
    MAX_TILES,
    Tile,
    TileLayout,
    ViewportConfig,
    Viewports,
    compose_tiles,
    fit_omni_camera,
    multi_view_layout,
    viewport_layout,
)
from catoptra_server.render.renderer import Image

UDK_LAYOUT = multi_view_layout(2, 2, width_px=320, height_px=240)


def grey_image(width: int, height: int, level: int) -> Image:
    return np.full((height, width, 3), level, dtype=np.uint8)


@pytest.mark.parametrize(
    ("index", "corner"), [(0, (0, 0)), (1, (320, 0)), (2, (0, 240)), (3, (320, 240))]
)
def test_udk_s_own_layout_when_square_has_udk_s_tiles(index: int, corner: tuple[int, int]) -> None:
    assert UDK_LAYOUT.tile_at(index) == Tile(*corner, 320, 240)


@pytest.mark.parametrize("index", [-1, 4, 100])
def test_camera_beyond_the_layout_has_no_tile(index: int) -> None:
    assert UDK_LAYOUT.tile_at(index) is None


@pytest.mark.parametrize(("columns", "rows"), [(4, 1), (4, 2), (1, 3), (3, 2)])
def test_layout_that_is_not_square_is_filled_without_gap_or_overlap(
    columns: int, rows: int
) -> None:
    layout = multi_view_layout(columns, rows, width_px=4, height_px=3)
    whole = compose_tiles(layout, [grey_image(4, 3, 1 + index) for index in range(len(layout))])
    assert whole.shape == (3 * rows, 4 * columns, 3)
    assert (np.bincount(whole[..., 0].ravel())[1:] == 12).all()


def test_qt_client_with_four_tiles_a_row_finds_each_camera() -> None:
    layout = multi_view_layout(4, 2, width_px=320, height_px=240)
    for n in range(8):
        tile = layout.tile_at(n)
        assert tile is not None
        assert (tile.x_px, tile.y_px) == ((n * 320) % 1280, (n // 4) * 240)


def test_single_view_is_the_whole_image() -> None:
    layout = viewport_layout(ViewportConfig("SingleView"), width_px=640, height_px=480)
    assert len(layout) == 1
    assert layout.tile_at(0) == Tile(0, 0, 640, 480)


def test_disabled_viewports_are_black() -> None:
    layout = viewport_layout(ViewportConfig("QuadView"), width_px=64, height_px=48)
    whole = compose_tiles(layout, [None, grey_image(32, 24, 9), None, None])
    assert (whole[:24, 32:] == 9).all()
    assert whole.sum() == 3 * 9 * 32 * 24


def test_odd_image_keeps_its_size_and_a_black_border() -> None:
    layout = viewport_layout(ViewportConfig.QUAD_VIEW, width_px=5, height_px=3)
    whole = compose_tiles(layout, [grey_image(2, 1, 7)] * 4)
    assert whole.shape == (3, 5, 3)
    assert (whole[:2, :4] == 7).all()
    assert whole[2:].max() == whole[:, 4:].max() == 0


def test_smaller_image_lies_in_the_corner_at_its_own_size() -> None:
    whole = compose_tiles(UDK_LAYOUT, [None, grey_image(100, 50, 200)])
    assert (whole[:50, 320:420] == 200).all()
    assert whole.sum() == 3 * 200 * 100 * 50


def test_larger_image_and_one_too_many_raise() -> None:
    with pytest.raises(DomainError, match="321 x 10 px exceeds its tile"):
        compose_tiles(UDK_LAYOUT, [grey_image(321, 10, 1)])
    with pytest.raises(DomainError, match="image 4 has no tile"):
        compose_tiles(UDK_LAYOUT, [None] * 4 + [grey_image(10, 10, 1)])


def test_composed_image_is_read_only() -> None:
    assert not compose_tiles(UDK_LAYOUT, []).flags.writeable


@pytest.mark.parametrize("layout", [(0, 1, 1, 1), (1, 0, 1, 1), (1, 1, 0, 1), (1, 1, 1, 0)])
def test_layout_without_pixels_raises(layout: tuple[int, int, int, int]) -> None:
    with pytest.raises(DomainError, match="has no pixel"):
        TileLayout(*layout, 1, 1)


@pytest.mark.parametrize(
    ("rectangle", "tiles"),
    [
        ((0, 0, 640, 480), (0, 1, 2, 3)),
        ((320, 0, 320, 240), (1,)),
        ((319, 0, 2, 240), (0, 1)),
        ((10, 239, 5, 2), (0, 2)),
        ((0, 0, 0, 0), (0,)),
        ((10_000, 10_000, 5, 5), (3,)),
    ],
)
def test_rectangle_overlaps_only_the_tiles_in_view(
    rectangle: tuple[int, int, int, int], tiles: tuple[int, ...]
) -> None:
    assert UDK_LAYOUT.tiles_overlapping(*rectangle) == tiles
    pictures = [grey_image(320, 240, 50 + index) for index in range(4)]
    shown = np.unique(crop(compose_tiles(UDK_LAYOUT, pictures), *rectangle))
    assert tuple(shown - 50) == tiles


def test_omni_camera_in_a_tile_is_scaled_and_centred() -> None:
    camera = OmniCamera(PAPER_MIRROR, 640, 480, (330.0, 235.0), 118.8, 2.0)
    small = fit_omni_camera(Tile(320, 0, 200, 240), camera)
    assert (small.width_px, small.height_px) == (200, 240)
    # 200 / 640 of the size; the remaining height is divided between top and bottom.
    places = np.array([[330.0, 235.0], [200.0, 100.0], [400.0, 300.0]])
    there = (places - (320.0, 240.0)) * 0.3125 + (100.0, 120.0)
    np.testing.assert_allclose(
        direction_from_pixel(small, there)[0], direction_from_pixel(camera, places)[0], atol=1e-14
    )


@pytest.mark.parametrize(("columns", "rows"), [(1000, 1000), (65, 1), (1, 65), (8, 9)])
def test_layout_of_too_many_tiles_is_rejected(columns: int, rows: int) -> None:
    with pytest.raises(DomainError, match=f"{columns} x {rows} tiles.*at most 64"):
        multi_view_layout(columns, rows, width_px=4, height_px=4)


def test_layout_of_as_many_tiles_as_allowed_is_made() -> None:
    assert len(multi_view_layout(8, 8, width_px=4, height_px=4).tiles) == MAX_TILES


def test_viewports_when_set_are_confirmed_in_the_captured_form() -> None:
    command = SetViewports("singleview", ("camera", "Disable", "Disable", "Disable"))
    assert line_from_report(Viewports(["Camera"]).execute(command, 1.0)) == (
        b"RES {Time 1.00} {Type Viewports} {Config SingleView} {Status OK} {Viewport1 Camera} "
        b"{Status OK} {Viewport2 Disabled} {Status OK} {Viewport3 Disabled} {Status OK} "
        b"{Viewport4 Disabled} {Status OK}\r\n"
    )


def test_viewports_when_a_camera_is_missing_fail_and_keep_the_rest() -> None:
    viewports = Viewports(["Camera", "Camera2"])
    viewports.execute(SetViewports("QuadView", (None, "Camera2", None, None)), 1.0)
    result = viewports.execute(SetViewports("Circle", (None, None, "Camera9", None)), 2.0)
    assert (result.config, result.status) == ("QuadView", "Failed")
    assert [(v.camera, v.status) for v in result.viewports] == [
        ("Camera", "OK"),
        ("Camera2", "OK"),
        ("None", "Failed"),
        ("Disabled", "OK"),
    ]
