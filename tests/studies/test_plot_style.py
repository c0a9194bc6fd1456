from __future__ import annotations

from pathlib import Path

import cv2
import matplotlib
import numpy as np
import pytest

from catoptra_studies import plot_style
from catoptra_studies.plot_style import map_error_colours

NOISE = np.random.default_rng(7).integers(0, 256, (20, 20, 3), dtype=np.uint8)


def test_image_shows_every_pixel_as_a_block_when_the_width_is_a_multiple(tmp_path: Path) -> None:
    with plot_style.open_page(tmp_path / "page.png", 80, 100) as page:
        plot_style.show_image(page, NOISE, 30, 10, 40)

    shown = cv2.imread(str(tmp_path / "page.png"))[10:50, 30:70, ::-1]
    assert np.array_equal(shown, NOISE.repeat(2, axis=0).repeat(2, axis=1))


def test_page_has_exactly_its_size_in_pixels(tmp_path: Path) -> None:
    with plot_style.open_page(tmp_path / "page.png", 123, 321):
        pass

    assert cv2.imread(str(tmp_path / "page.png")).shape == (123, 321, 3)


def test_settings_end_with_the_page(tmp_path: Path) -> None:
    before = matplotlib.rcParams["font.size"]
    with plot_style.open_page(tmp_path / "page.png", 50, 50):
        assert matplotlib.rcParams["font.size"] != before

    assert matplotlib.rcParams["font.size"] == before


def test_chart_when_the_block_ends_is_written(tmp_path: Path) -> None:
    with plot_style.open_chart(tmp_path / "chart.png", figsize=(2.0, 1.0)) as figure:
        figure.subplots().plot([0, 1], [0, 1])

    assert cv2.imread(str(tmp_path / "chart.png")).shape == (200, 400, 3)


WHITE = (255, 255, 255)


@pytest.mark.parametrize("error", [0.0, 0.05, 0.1])
def test_colour_when_the_error_is_below_the_scale_is_white(error: float) -> None:
    assert tuple(map_error_colours(np.array(error), 0.1, 100.0)) == WHITE


def test_colour_when_the_error_is_above_the_scale_is_that_of_its_end() -> None:
    ends = map_error_colours(np.array([100.0, 1e6]), 0.1, 100.0)
    assert tuple(ends[0]) == tuple(ends[1])


def test_scale_bar_grows_darker_all_the_way(tmp_path: Path) -> None:
    with plot_style.open_page(tmp_path / "page.png", 80, 100) as page:
        plot_style.draw_colour_bar(
            page, (1.0, 128.0), left=20, top=10, width=60, ticks=(1, 128), title=""
        )

    # Within the axes' frame of two pixels.
    row = cv2.imread(str(tmp_path / "page.png"))[20, 22:78, ::-1]
    brightness = row.astype(float) @ (0.299, 0.587, 0.114)
    assert (np.diff(brightness) < 0.0).all()
