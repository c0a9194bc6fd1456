from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.renderer import Image
from catoptra_studies.camera_figures.figure_subject import PAPER_SIZE_PX, FigureSubject
from catoptra_studies.camera_figures.ring_radii import NUM_SECTORS, measure_ring_radii


@pytest.fixture(scope="module")
def measured(subject: FigureSubject) -> Floats:
    camera = subject.resize_camera(PAPER_SIZE_PX)
    return measure_ring_radii(subject.render_rings(samples=6), rim_radius_px=camera.rim_radius_px)


def law_px(subject: FigureSubject, rings: int) -> tuple[Floats, Floats]:
    """Return the radii of the rings by the mirror's law, and by Eq. 2."""
    camera = subject.resize_camera(PAPER_SIZE_PX)
    t = np.tan(np.radians(0.5 * 5.0 * np.arange(1, rings + 1)))
    exact = camera.mirror.radius_ratio_from_t(t)
    return camera.horizon_radius_px * exact, camera.horizon_radius_px * t


def test_every_ring_within_the_rim_is_found(measured: Floats) -> None:
    assert measured.shape == (NUM_SECTORS, 23)


def test_rings_lie_where_the_exact_law_says_in_every_sector(
    measured: Floats, subject: FigureSubject
) -> None:
    exact, _ = law_px(subject, 23)

    # The paper's claim made sharp: a tenth of a pixel.
    assert np.abs(measured - exact).max() < 0.1
    assert np.abs(measured.mean(axis=0) - exact).max() < 0.05


def test_eq2_departs_measurably_beyond_the_horizon(
    measured: Floats, subject: FigureSubject
) -> None:
    _, eq2 = law_px(subject, 23)

    # 0.540 px at 115 degrees by the optics notes, 1.3; the pixels are good to 0.02 px there.
    assert measured.mean(axis=0)[-1] - eq2[-1] == pytest.approx(0.540, abs=0.02)


def test_a_drawn_ring_is_measured_without_knowing_any_law() -> None:
    assert measure_ring_radii(drawn_ring(40.3), rim_radius_px=80.0) == pytest.approx(40.3, abs=0.1)


def test_a_picture_without_rings_is_refused_with_a_remedy() -> None:
    white = np.full((180, 180, 3), 255, dtype=np.uint8)

    with pytest.raises(CatoptraError, match="--rings-world must be"):
        measure_ring_radii(white, rim_radius_px=80.0)


def drawn_ring(radius_px: float) -> Image:
    """Return a dark ring two pixels wide, of 8 x 8 samples a pixel."""
    steps = (np.arange(180 * 8) + 0.5) / 8 - 90.0
    distance = np.hypot(*np.meshgrid(steps, steps))
    light = np.where(np.abs(distance - radius_px) < 1.0, 0.0, 255.0)
    mean = light.reshape(180, 8, 180, 8).mean(axis=(1, 3))
    return np.repeat(np.rint(mean).astype(np.uint8)[..., None], 3, axis=-1)


def test_drawn_ring_is_what_it_says() -> None:
    area = (255.0 - drawn_ring(40.3)[..., 0].astype(float)).sum() / 255.0
    assert area == pytest.approx(4.0 * math.pi * 40.3, rel=0.01)
