"""Two frames of different formats are shown with mirrors of one size."""

from __future__ import annotations

import math

import cv2
import numpy as np

from catoptra_studies.experiment.report_figures import draw_frame_pair
from catoptra_studies.plot_style import PAGE_WIDTH_PX


def make_disc(height: int, width: int) -> np.ndarray:
    """White disc that touches the longer sides of a black frame."""
    frame = np.zeros((height, width, 3), np.uint8)
    cv2.circle(frame, (width // 2, height // 2), height // 2 - 1, (255, 255, 255), -1)
    return frame


def test_mirrors_of_a_wide_and_a_square_frame_are_equally_large(tmp_path):
    path = tmp_path / "pair.png"
    draw_frame_pair(path, (("wide", make_disc(60, 80)), ("square", make_disc(90, 90))))
    shown = cv2.imread(str(path))
    assert shown.shape == (800, PAGE_WIDTH_PX, 3)
    # A disc covers pi / 4 of the square around it; these are a pixel smaller all around.
    for left in (20, 780):
        share = (shown[60:780, left : left + 720] > 128).mean()
        assert abs(share - math.pi / 4.0) < 0.07
