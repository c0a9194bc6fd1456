"""Cameras at one place of a world: poses, frames, times."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.command_line import CommandParser
from catoptra_studies.cameras.camera_stage import (
    CameraStage,
    add_camera_options,
    open_requested_stage,
)


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[CameraStage]:
    """The paper's mirror and a fish-eye lens on the field, with small images."""
    parser = CommandParser("catoptra-studies cameras")
    add_camera_options(parser, size_px=60)
    parsed = parser.parse_args(["--cameras", "paper,equidistant_220"])
    parsed.out = tmp_path
    with open_requested_stage(parsed) as (opened, _):
        yield opened


def test_all_cameras_have_the_viewpoint_of_the_paper(stage: CameraStage) -> None:
    assert [camera.height_m for camera in stage.cameras] == pytest.approx([0.6, 0.6])
    first, second = (state.world_from_mirror.translation for state in stage.states)
    np.testing.assert_allclose(first, second, atol=1e-6)
    assert first[2] == pytest.approx(-0.6)


def test_frame_has_the_size_of_its_camera_and_content(stage: CameraStage) -> None:
    for index in range(len(stage.cameras)):
        image = stage.render_frame(index)
        assert image.shape == (60, 60, 3)
        assert image.std() > 5.0


def test_every_camera_is_timed(stage: CameraStage) -> None:
    times_ms = stage.time_frames(1)
    assert len(times_ms) == 2
    assert min(times_ms) > 0.0
