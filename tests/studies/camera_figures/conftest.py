from __future__ import annotations

from collections.abc import Iterator

import pytest

from catoptra_studies.camera_figures.figure_spec import FigureInputs, open_figure_inputs
from catoptra_studies.study_subject import StudySubject
from helpers.configs import FIELD, OMNI_ROBOT, WORLDS


@pytest.fixture(scope="package")
def inputs() -> Iterator[FigureInputs]:
    """The paper's robot on its field, rendered small; only the rings have their full size."""
    rings = WORLDS / "incidence_rings.ini"
    with open_figure_inputs(
        OMNI_ROBOT,
        FIELD,
        rings,
        WORLDS / "corridors_and_rooms.ini",
        resolution_scale=0.25,
        num_timed_frames=1,
    ) as inputs:
        yield inputs


@pytest.fixture(scope="package")
def subject(inputs: FigureInputs) -> StudySubject:
    return inputs.subject
