"""A calibration file of another program: into a robot file, drawn, and out again."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.exports import ExportedFile, export_camera
from catoptra_protocol.calibration.formats import find_format
from catoptra_protocol.calibration.model_fits import compute_residual
from catoptra_protocol.optics.image_plane import ImagePlane
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.robot_file import read_robot
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import PerPixel, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.calibrated_cameras import (
    LAFIDA,
    THETA_BACK,
    TUM_VI,
    TUM_VI_KB,
    WOODSCAPE,
    flipped_points,
)
from helpers.configs import ROBOTS, write_edited_copy
from helpers.long_cases import quick_cases
from helpers.markers import marker_centroid, marker_world

# CamOdoCal and Kalibr have no skew.
UNSKEWED = replace(THETA_BACK, plane=ImagePlane((1.0, 0.0, 0.0, 1.01), 1e-3, -5e-4))
CASES: list[tuple[str, OmniCamera]] = [
    ("opencv_omnidir", THETA_BACK),
    ("boofcv", THETA_BACK),
    ("camodocal", UNSKEWED),
    ("kalibr_omni", UNSKEWED),
    ("kalibr_ds", TUM_VI),
    ("basalt_ds", TUM_VI),
    ("basalt_kb4", TUM_VI_KB),
    ("ocamcalib", LAFIDA),
    ("woodscape", WOODSCAPE),
]


def read_robot_with(file_name: str, folder: Path) -> OmniCamera:
    """Camera that a robot has by a calibration file beside its own."""
    write_edited_copy(ROBOTS / "p2at.ini", folder)
    robot = folder / "robot.ini"
    robot.write_text(
        "[Configuration]\nBasedOn=p2at.ini\n[USARBot.P2AT]\n"
        "Cameras=(ItemClass=class'Catoptra.Eye',ItemName=\"Eye\",Position=(X=0,Y=0,Z=-0.5))\n"
        f"[Catoptra.Eye]\nCalibrationFile={file_name}\n"
    )
    description, _ = read_robot(robot)
    (omni,) = description.omni_cameras
    return omni.camera


@pytest.mark.parametrize(
    ("name", "truth"), quick_cases(CASES, 4, 7), ids=[case[0] for case in CASES]
)
def test_imported_camera_is_drawn_and_exported_as_it_was(
    name: str, truth: OmniCamera, tmp_path: Path
) -> None:
    one = find_format(name)
    (tmp_path / name).write_text(one.write(truth, "eye"))
    camera = read_robot_with(name, tmp_path)
    assert compute_residual(truth, camera).max_px < 1e-9
    assert marker_error_px(camera, truth) < 0.1
    result = export_camera(camera, one, name="eye", picture=Picture.FLIPPED)
    assert isinstance(result, ExportedFile)
    again = tmp_path / "again"
    again.write_text(result.text)
    assert compute_residual(truth, camera_from_file(again)).max_px < 1e-9


def marker_error_px(camera: OmniCamera, truth: OmniCamera) -> float:
    """Distance of a drawn marker from the pixel of the camera that the file was made from."""
    directions, pixels, valid = flipped_points(truth)
    angle = np.arccos(directions[:, 2])
    near = np.abs(angle - math.radians(40.0)) < math.radians(1.0)
    index = int(np.flatnonzero(valid & near)[0])
    pixel = pixels[index] + 0.5
    # The imported camera has its image's top along +x, too.
    x, y, z = directions[index]
    direction = np.array((-y, x, z))
    world: World = marker_world(
        direction[None], diameter_rad=5.0 / float(camera.radius_slope_px(np.array(0.36)))
    )
    renderer = TraceRenderer(build_scene(world), world, threads=1)
    settings = RenderSettings(PerPixel(), samples=3)
    plan = plan_from_settings(settings, camera, kind=RendererKind.TRACE, reason="test")
    view = renderer.prepare(camera, plan)
    image = view.render(CameraState(Pose.identity()))
    view.close()
    renderer.close()
    return float(np.linalg.norm(marker_centroid(image.rgb, pixel) - pixel))
