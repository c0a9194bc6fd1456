"""Sizes of face regions in texels."""

from __future__ import annotations

import pytest

from catoptra_protocol.optics.cube_map import Face
from catoptra_server.render.renderer import FaceRegion, FaceWindow


def test_size_of_a_region_is_window_times_density() -> None:
    region = FaceRegion(Face.N, FaceWindow(top=-0.5), columns_per_unit=100.0, rows_per_unit=50.0)
    assert region.size_texels == (200.0, 75.0)
    assert region.num_texels == 15_000.0


@pytest.mark.parametrize(
    ("window", "is_empty"),
    [
        (FaceWindow(), False),
        (FaceWindow(top=1.0), True),
        (FaceWindow(left=0.2, right=0.2), True),
        (FaceWindow(top=0.999), False),
    ],
)
def test_window_without_area_is_empty(window: FaceWindow, is_empty: bool) -> None:
    assert window.is_empty is is_empty
