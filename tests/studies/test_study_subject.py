from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.omni_camera import camera_with_inscribed_rim
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_studies.study_subject import open_study_subject, resize_camera
from helpers.configs import FIELD, OMNI_ROBOT, ROBOTS


def test_subject_has_a_camera_of_the_size_and_separate_poses() -> None:
    with open_study_subject(OMNI_ROBOT, FIELD, size_px=50, num_poses=4) as subject:
        assert (subject.camera.width_px, subject.camera.height_px) == (50, 50)
        positions = np.array([e.world_from_mirror.translation for e in subject.camera_states])
        assert RendererKind.TRACE in subject.renderers
    assert len(positions) == 4
    # The robot's viewpoint is 0.6 m above the floor, and the field's first start is its centre.
    assert positions[:, 2] == pytest.approx(-0.6, abs=1e-6)
    assert np.hypot(*positions[:, :2].T).max() < 0.6
    steps = [math.dist(a, b) for n, a in enumerate(positions) for b in positions[:n]]
    assert min(steps) > 0.3


def test_reference_has_a_frame_for_each_pose() -> None:
    with open_study_subject(OMNI_ROBOT, FIELD, size_px=40, num_poses=2) as subject:
        first, second = subject.render_reference(2)
    assert first.shape == (40, 40, 3)
    assert not np.array_equal(first, second)


@pytest.mark.parametrize(
    ("robot", "world", "reason"),
    [
        (ROBOTS / "p2at.ini", FIELD, "no omnidirectional camera: take a robot"),
        (OMNI_ROBOT, Path("no.ini"), r"no\.ini"),
    ],
)
def test_file_when_missing_or_without_a_camera_is_rejected_with_the_reason(
    robot: Path, world: Path, reason: str
) -> None:
    with (
        pytest.raises(CatoptraError, match=reason),
        open_study_subject(robot, world, size_px=40, num_poses=1),
    ):
        pass


def test_camera_when_resized_keeps_its_rim_inscribed() -> None:
    camera = camera_with_inscribed_rim(PAPER_MIRROR, width_px=640, height_px=480, rim_rad=2.0)
    assert resize_camera(camera, 720).rim_radius_px == pytest.approx(360.0)
