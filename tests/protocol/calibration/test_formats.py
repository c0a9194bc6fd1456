"""Formats: every file through the reader of its own program, and published files of each."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration.exports import ExportedFile, export_camera
from catoptra_protocol.calibration.formats import FORMATS, CalibrationFormat
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.lenses import (
    EnhancedUnifiedLens,
    EquidistantLens,
    KannalaBrandtLens,
    OCamLens,
    StereographicLens,
    UnifiedLens,
)
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture
from helpers import foreign_readers
from helpers.calibrated_cameras import (
    LAFIDA,
    PAPER,
    THETA_BACK,
    TUM_VI,
    TUM_VI_KB,
    WOODSCAPE,
    flipped_points,
)


def _eye(lens: object, field_deg: float) -> OmniCamera:
    return camera_with_inscribed_rim(
        lens,  # type: ignore[arg-type]
        width_px=640,
        height_px=480,
        rim_rad=math.radians(0.5 * field_deg),
        picture=Picture.FLIPPED,
    )


CAMERAS = {
    "paper": PAPER,
    "theta": THETA_BACK,
    "tum_vi": TUM_VI,
    "tum_vi_kb": TUM_VI_KB,
    "narrow_kb": replace(TUM_VI_KB, rim_rad=math.radians(88.0)),
    "lafida": replace(LAFIDA, rim_rad=math.radians(85.0)),
    "woodscape": WOODSCAPE,
    "eucm": _eye(EnhancedUnifiedLens(0.6, 1.1), 170.0),
    "stereographic": _eye(StereographicLens(), 220.0),
    "equidistant": _eye(EquidistantLens(), 178.0),
    "flat": _eye(UnifiedLens(0.0, -0.02, 0.001), 80.0),
    "decentred": replace(
        _eye(UnifiedLens(0.0, -0.1), 60.0), plane=ImagePlane((1.0, 0.0, 0.0, 1.01), 1e-3, -5e-4)
    ),
}
# The inverse polynomial of OCam's readers is a fit.
_INVERSE_PX = 0.06


@pytest.mark.parametrize("each", FORMATS, ids=lambda each: each.name)
def test_file_is_projected_alike_by_its_own_program(
    each: CalibrationFormat, tmp_path: Path
) -> None:
    if each.program == "COLMAP":
        pytest.importorskip("pycolmap", reason="COLMAP itself, of the extra `outside`")
    bound_px = _INVERSE_PX if each.model.lens is OCamLens else 1e-9
    num_read = 0
    for name, camera in CAMERAS.items():
        result = export_camera(camera, each, name="cam", picture=Picture.FLIPPED)
        if not isinstance(result, ExportedFile):
            continue
        folder = tmp_path / name
        folder.mkdir()
        (folder / each.file_name).write_text(result.text)
        project = foreign_readers.read(folder / each.file_name, each.name)
        # A pixel exactly at 90 degrees has no side in front.
        widest = min(camera.rim_rad, result.camera.rim_rad, each.max_angle_rad - 1e-6)
        points, expected, valid = flipped_points(replace(result.camera, rim_rad=widest))
        valid &= points[:, 2] < 1.0 - 1e-12
        assert np.abs(project(points[valid]) - expected[valid]).max() <= bound_px, name
        num_read += 1
    assert num_read >= (2 if each.model.lens in (UnifiedLens, KannalaBrandtLens) else 1)
