"""Subjects of the figures: pose and size of the camera in the world and among the rings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_studies.camera_figures.figure_spec import FigureInputs, open_figure_inputs
from catoptra_studies.study_subject import StudySubject
from helpers.configs import FIELD, OMNI_ROBOT, WORLDS


def translation(subject: StudySubject) -> np.ndarray:
    return subject.camera_states[0].world_from_mirror.translation


def test_frame_is_rendered_at_the_resolution_scale(inputs: FigureInputs) -> None:
    assert inputs.subject.render_frame(200, samples=1).shape == (50, 50, 3)


def test_viewpoint_when_a_pose_is_given_is_there() -> None:
    pose = PlanarPose(1.0, -0.5, math.radians(90.0))
    rings = WORLDS / "incidence_rings.ini"
    with open_figure_inputs(OMNI_ROBOT, FIELD, rings, rings, pose=pose) as inputs:
        viewpoint = inputs.subject.camera_states[0].world_from_mirror

    assert viewpoint.translation == pytest.approx([1.0, -0.5, -0.6])
    assert viewpoint.rotate_directions(np.array([1.0, 0.0, 0.0])) == pytest.approx([0.0, 1.0, 0.0])


def test_viewpoint_without_a_pose_is_beside_the_first_start(inputs: FigureInputs) -> None:
    # The field's first start is its centre, facing +x: a step back and left.
    assert translation(inputs.subject) == pytest.approx([-0.45, -0.35, -0.6])


def test_rings_are_rendered_from_their_centre(inputs: FigureInputs) -> None:
    assert translation(inputs.rings) == pytest.approx([0.0, 0.0, -0.6])
