"""Two cameras of small images in the field."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from catoptra_server.config.camera_file import read_camera_files
from catoptra_studies.cameras.camera_stage import CameraStage, open_stage
from helpers.configs import FIELD


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[CameraStage]:
    """The paper's mirror and a fish-eye lens."""
    files = read_camera_files(["paper", "equidistant_220"])
    with open_stage(files, FIELD, tmp_path, size_px=60) as opened:
        yield opened
