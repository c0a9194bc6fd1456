"""Two frames of different formats have mirrors of one size; no curve crosses a text."""

from __future__ import annotations

import math
from contextlib import contextmanager

import cv2
import numpy as np

from catoptra_studies.experiment import report_figures
from catoptra_studies.experiment.report_figures import draw_frame_pair
from catoptra_studies.plot_style import PAGE_WIDTH_PX, open_chart
from studies.experiment.test_metrics import make_filter_run


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


def test_texts_of_the_papers_limits_are_outside_the_curves(tmp_path, monkeypatch):
    kept = []

    @contextmanager
    def open_and_keep(*arguments, **options):
        with open_chart(*arguments, **options) as figure:
            yield figure
            figure.canvas.draw()
            kept.append(figure)

    monkeypatch.setattr(report_figures, "open_chart", open_and_keep)
    runs = [make_filter_run(0, largest_m=0.6), make_filter_run(1, largest_m=1.2)]
    report_figures.draw_position_errors(tmp_path / "a.png", [("sim", runs[0]), ("real", runs[1])])
    report_figures.draw_error_ensemble(tmp_path / "b.png", [("sim", runs)])
    assert len(kept) == 2
    for figure in kept:
        (legend,) = figure.legends
        assert any("0.6 m" in text.get_text() for text in legend.get_texts())
        frame = legend.get_window_extent()
        assert frame.x0 >= 0.0
        assert frame.x1 <= figure.bbox.x1
        for axes in figure.axes:
            assert not axes.texts
            assert not frame.overlaps(axes.get_tightbbox())
