"""The command `catoptra-studies cameras`, and its gallery: rings, numbers, page."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_studies.cameras import cameras_command
from catoptra_studies.cameras.camera_stage import CameraStage
from catoptra_studies.cameras.cameras_command import describe_camera, draw_gallery, ring_pixels


def test_gallery_of_one_camera_is_written(tmp_path: Path) -> None:
    words = ["--cameras", "parabolic", "--size", "60", "--frames", "1", "--output", str(tmp_path)]
    assert cameras_command.main(words) == 0
    assert (tmp_path / "index.html").exists()
    assert (tmp_path / "parabolic.png").exists()


def test_unknown_camera_is_named_with_all_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cameras_command.main(["--cameras", "papr", "--output", str(tmp_path)]) == 2
    error = capsys.readouterr().err
    assert "papr" in error
    assert "parabolic" in error


def test_gallery_has_a_picture_and_a_row_for_each_camera(
    stage: CameraStage, tmp_path: Path
) -> None:
    drawn: list[int] = []
    page = draw_gallery(stage, tmp_path, num_timed=1, on_camera=lambda: drawn.append(1))
    rows = json.loads((tmp_path / "cameras.json").read_text())
    assert [row["name"] for row in rows] == ["paper", "equidistant_220"]
    assert len(drawn) == 2
    text = page.read_text()
    assert text.count("data:image/png") == 2
    assert "Miyamoto" in text


def test_ring_has_the_radius_of_its_angle(stage: CameraStage) -> None:
    camera = stage.cameras[1].camera
    radius = np.hypot(*(ring_pixels(camera, math.radians(60.0)) - camera.centre_px).T)
    np.testing.assert_allclose(radius, camera.scale_px * math.radians(60.0), atol=1e-9)


def test_ring_beyond_the_rim_is_not_drawn(stage: CameraStage) -> None:
    assert np.isnan(ring_pixels(stage.cameras[1].camera, math.radians(120.0))).all()


def test_camera_without_a_fold_has_none(stage: CameraStage) -> None:
    row = describe_camera(stage.cameras[0], 1.0)
    assert row["first_fold_deg"] is None
    assert (row["central_beyond_m"], row["covered_sphere"]) == (0.0, 0.75)
