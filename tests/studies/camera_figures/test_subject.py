from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_server.robot.planar_pose import PlanarPose
from catoptra_studies.camera_figures.figure_subject import FigureSubject, open_figure_subject
from helpers.configs import FIELD, OMNI_ROBOT, WORLDS


def test_camera_of_another_size_keeps_its_rim_inscribed(subject: FigureSubject) -> None:
    assert subject.resize_camera(720).rim_radius_px == pytest.approx(360.0)


def test_frame_is_rendered_at_the_detail_asked_for(subject: FigureSubject) -> None:
    assert subject.render_frame(200, samples=1).shape == (50, 50, 3)


def test_viewpoint_stands_where_the_pose_says() -> None:
    pose = PlanarPose(1.0, -0.5, math.radians(90.0))
    with open_figure_subject(
        OMNI_ROBOT, FIELD, WORLDS / "incidence_rings.ini", pose=pose
    ) as subject:
        viewpoint = subject.world_from_mirror

    assert viewpoint.translation == pytest.approx([1.0, -0.5, -0.6])
    assert viewpoint.rotate_directions(np.array([1.0, 0.0, 0.0])) == pytest.approx([0.0, 1.0, 0.0])


def test_without_a_pose_the_robot_stands_beside_the_first_start(subject: FigureSubject) -> None:
    # The field's first start is its centre, facing +x: a step back and left.
    assert subject.world_from_mirror.translation == pytest.approx([-0.45, -0.35, -0.6])


def test_rings_are_pictured_from_their_middle(subject: FigureSubject) -> None:
    assert subject.rings_from_mirror.translation == pytest.approx([0.0, 0.0, -0.6])
