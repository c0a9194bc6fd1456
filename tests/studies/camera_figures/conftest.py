from __future__ import annotations

from collections.abc import Iterator

import pytest

from catoptra_studies.camera_figures.figure_subject import FigureSubject, open_figure_subject
from helpers.configs import FIELD, OMNI_ROBOT, WORLDS


@pytest.fixture(scope="package")
def subject() -> Iterator[FigureSubject]:
    """Return the paper's robot on its field, pictured small: only the rings have their size."""
    rings = WORLDS / "incidence_rings.ini"
    with open_figure_subject(OMNI_ROBOT, FIELD, rings, pose=None, resolution_scale=0.25) as opened:
        yield opened
