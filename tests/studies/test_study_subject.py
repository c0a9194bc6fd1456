from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_studies.study_subject import open_study_subject
from helpers.configs import FIELD, OMNI_ROBOT, ROBOTS


def test_subject_has_a_camera_of_the_size_and_places_apart() -> None:
    with open_study_subject(OMNI_ROBOT, FIELD, size_px=50, num_poses=4) as subject:
        assert (subject.camera.width_px, subject.camera.height_px) == (50, 50)
        places = np.array([e.world_from_mirror.translation for e in subject.camera_states])
        assert RendererKind.TRACE in subject.renderers
    assert len(places) == 4
    # The robot's viewpoint is 0.6 m above the floor, and the field's first start is its middle.
    assert places[:, 2] == pytest.approx(-0.6, abs=1e-6)
    assert np.hypot(*places[:, :2].T).max() < 0.6
    steps = [math.dist(a, b) for n, a in enumerate(places) for b in places[:n]]
    assert min(steps) > 0.3


def test_reference_has_a_frame_for_each_place() -> None:
    with open_study_subject(OMNI_ROBOT, FIELD, size_px=40, num_poses=2) as subject:
        first, second = subject.render_reference(2)
    assert first.shape == (40, 40, 3)
    assert not np.array_equal(first, second)


def test_robot_when_it_has_no_camera_is_refused_with_a_remedy() -> None:
    with (
        pytest.raises(CatoptraError, match="no omnidirectional camera to measure"),
        open_study_subject(ROBOTS / "p2at.ini", FIELD, size_px=40, num_poses=1),
    ):
        pass


def test_world_when_missing_is_refused(tmp_path: Path) -> None:
    with (
        pytest.raises(CatoptraError, match=r"no\.ini"),
        open_study_subject(OMNI_ROBOT, tmp_path / "no.ini", size_px=40, num_poses=1),
    ):
        pass
