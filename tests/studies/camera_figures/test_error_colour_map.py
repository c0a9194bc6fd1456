from __future__ import annotations

import numpy as np
import pytest

from catoptra_studies.plot_style import colour_bar, map_error_colours

WHITE = (255, 255, 255)


@pytest.mark.parametrize("error", [0.0, 0.05, 0.1])
def test_colour_when_the_error_is_below_the_scale_is_white(error: float) -> None:
    assert tuple(map_error_colours(np.array(error), 0.1, 100.0)) == WHITE


def test_colour_when_the_error_is_above_the_scale_is_that_of_its_end() -> None:
    ends = map_error_colours(np.array([100.0, 1e6]), 0.1, 100.0)
    assert tuple(ends[0]) == tuple(ends[1])


def test_scale_bar_grows_darker_all_the_way() -> None:
    bar = colour_bar(60, 5, 1.0, 128.0)
    assert bar.shape == (5, 60, 3)
    brightness = bar[0].astype(float) @ (0.299, 0.587, 0.114)
    assert (np.diff(brightness) < 0.0).all()
