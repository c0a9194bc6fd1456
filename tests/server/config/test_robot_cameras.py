"""Cameras of robot files without a mirror: lenses, calibrations, and perspective cameras."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from catoptra_protocol.calibration.formats import find_format
from catoptra_protocol.calibration.model_fits import compute_residual
from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.lenses import EquidistantLens
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.config.robot_file import read_robot, read_robots
from catoptra_server.effects import EFFECT_TYPES, NO_EFFECT_SETTINGS, EffectSettings
from catoptra_server.simulation.robot_description import OmniCameraDescription, RobotDescription
from helpers.calibrated_cameras import TUM_VI
from helpers.configs import ROBOTS, write_edited_copy

FISHEYE = ROBOTS / "p2at_fisheye.ini"
ITEM = "Cameras=(ItemClass=class'Catoptra.Eye',ItemName=\"Eye\",{mount})\n"


def read_eye(
    folder: Path,
    *lines: str,
    mount: str = "Position=(X=0,Y=0,Z=-0.5)",
    lens: str = "Lens=equidistant",
) -> OmniCameraDescription:
    """Camera of a robot file with these lines in the section of its lens camera."""
    write_edited_copy(ROBOTS / "p2at.ini", folder)
    path = folder / "robot.ini"
    item = ITEM.replace("{mount}", mount)
    path.write_text(
        "[Configuration]\nBasedOn=p2at.ini\n[USARBot.P2AT]\n"
        + item
        + "\n".join(("[Catoptra.Eye]", lens, *lines, ""))
    )
    robot, file = read_robot(path)
    assert file.unknown_names() == []
    (omni,) = robot.omni_cameras
    return omni


def bundled() -> RobotDescription:
    return read_robot(FISHEYE)[0]


def test_lens_when_hanging_has_the_robot_s_axes() -> None:
    hanging = bundled().omni_cameras[0]
    assert hanging.robot_from_mirror.rotation == pytest.approx(np.eye(3), abs=1e-5)
    assert bundled().viewpoint_height_m(hanging) == pytest.approx(0.6)


def test_lens_when_ahead_shows_the_right_on_the_right_and_the_floor_below() -> None:
    ahead = bundled().omni_cameras[1]
    camera, mount = ahead.camera, ahead.robot_from_mirror
    in_mirror = mount.inverse().rotate_directions(np.array([[1.0, 0, 0], [1, 1, 0], [1, 0, 1]]))
    centre, right, below = camera.pixel_from_direction(in_mirror)[0]
    assert centre == pytest.approx(camera.centre_px)
    assert right == pytest.approx((camera.centre_px[0] + camera.scale_px * math.pi / 4, centre[1]))
    assert below == pytest.approx((centre[0], camera.centre_px[1] + camera.scale_px * math.pi / 4))


def test_lens_by_its_field_of_view_touches_the_nearer_borders(tmp_path: Path) -> None:
    camera = read_eye(tmp_path, "FieldOfView=360", "ResolutionX=400", "ResolutionY=300").camera
    assert (camera.rim_rad, camera.rim_radius_px) == (math.pi, 150.0)


def test_lens_by_its_focal_length_has_the_calibrated_plane(tmp_path: Path) -> None:
    lines = ("FocalLength=100", "FocalLengthY=101", "Skew=0.5", "CentreU=310", "CentreV=330")
    camera = read_eye(tmp_path, *lines, "Picture=mirrored").camera
    assert (camera.projection, camera.scale_px) == (EquidistantLens(), 100.0)
    assert (camera.centre_px, camera.picture) == ((310.0, 330.0), Picture.MIRRORED)
    assert camera.plane.stretch == (1.0, 0.005, 0.0, 1.01)
    # The farthest corner is 330 px right and down: as far as the lens may be seen.
    assert camera.rim_rad == pytest.approx(math.pi)


def test_lens_when_its_corners_are_nearer_than_its_limit_ends_there(tmp_path: Path) -> None:
    camera = read_eye(tmp_path, "FocalLength=400").camera
    assert camera.rim_rad == pytest.approx(math.hypot(320, 320) / 400)


def test_lens_on_a_link_moves_with_the_link(tmp_path: Path) -> None:
    omni = read_eye(tmp_path, "FieldOfView=180", mount='Parent="CameraTilt"')
    robot = read_robot(tmp_path / "robot.ini")[0]
    at_rest = robot.robot_from_omni(omni, {})
    turned = robot.robot_from_omni(omni, {"camerapan": 0.5})
    assert not np.allclose(at_rest.rotation, turned.rotation)


BAD = [
    (("Lens=wide", "FieldOfView=90"), "Lens='wide': expected one of equidistant"),
    ((), "FocalLength.*a FocalLength in px, a FieldOfView in degrees or both"),
    (("FieldOfView=361",), "FieldOfView='361'"),
    (("FocalLength=100", "Stretch=1,2,3"), "four numbers"),
    (("FocalLength=100", "Stretch=1,0,0,-1"), "positive determinant"),
    (("FocalLength=100", "P1=0.1"), "radial distortion"),
    (("FieldOfView=90", "MirrorDust=auto"), "which has no mirror"),
    (("FieldOfView=90", "Picture=sideways"), "mirrored, flipped"),
]


@pytest.mark.parametrize(("lines", "message"), BAD)
def test_lens_when_impossible_is_rejected_at_its_key(
    tmp_path: Path, lines: tuple[str, ...], message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        read_eye(tmp_path, *lines)


def test_calibration_file_is_the_camera(tmp_path: Path) -> None:
    (tmp_path / "chain.yaml").write_text(find_format("kalibr_ds").write(TUM_VI, "left"))
    lines = ("CalibrationFile=chain.yaml", "CalibrationCamera=cam0")
    camera = read_eye(tmp_path, *lines, lens="").camera
    assert camera.projection == TUM_VI.projection
    assert (camera.width_px, camera.picture) == (512, Picture.FLIPPED)
    assert compute_residual(TUM_VI, camera).max_px < 1e-9
    narrow = read_eye(tmp_path, *lines, "FieldOfView=100", "Picture=mirrored", lens="").camera
    assert narrow.rim_rad == pytest.approx(math.radians(50.0))
    assert narrow.picture is Picture.MIRRORED


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("CalibrationFile=none.yaml",), "none.yaml"),
        (("CalibrationFile=chain.yaml", "CalibrationCamera=cam7"), r"cam7=.*which has cam0"),
        (("CalibrationFile=chain.yaml", "FieldOfView=300"), r"FieldOfView=.*first fold"),
        (("CalibrationFile=chain.yaml", "ResolutionX=640"), r"ResolutionX='640'.*expected 512"),
        (("CalibrationFile=chain.yaml", "ResolutionY=480"), r"ResolutionY='480'.*expected 512"),
    ],
)
def test_calibration_file_that_does_not_fit_is_rejected(
    tmp_path: Path, lines: tuple[str, ...], message: str
) -> None:
    (tmp_path / "chain.yaml").write_text(find_format("kalibr_ds").write(TUM_VI, "left"))
    with pytest.raises(ConfigError, match=message):
        read_eye(tmp_path, *lines, lens="")


def test_calibration_file_without_a_size_takes_that_of_the_section(tmp_path: Path) -> None:
    (tmp_path / "kd.yaml").write_text(
        "K: [190.0, 0, 319.5, 0, 191.0, 239.5, 0, 0, 1]\nD: [0.0, 0.0, 0.0, 0.0]\n"
    )
    lines = ("CalibrationFile=kd.yaml", "ResolutionX=640", "ResolutionY=480")
    camera = read_eye(tmp_path, *lines, lens="").camera
    assert (camera.width_px, camera.height_px, camera.centre_px) == (640, 480, (320.0, 240.0))
    with pytest.raises(ConfigError, match=r"kd\.yaml: size='missing'.*ResolutionX"):
        read_eye(tmp_path, lines[0], lens="")


def test_lens_when_larger_than_the_memory_limit_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="ResolutionX='8192 x 8192 px"):
        read_eye(tmp_path, "FieldOfView=90", "ResolutionX=8192", "ResolutionY=8192", "Samples=4")


def test_camera_when_of_the_real_udk_line_has_its_class_s_numbers() -> None:
    (camera,) = read_robot(ROBOTS / "p3at_udk.ini")[0].perspective_cameras
    assert (camera.name, camera.mount.position_m) == ("Camera", (0.1005, 0.0, -0.42))
    assert (camera.fov_rad, camera.min_fov_rad, camera.max_fov_rad) == (1.3963, 0.3491, 2.0944)


def test_camera_when_of_the_p2at_sits_on_its_pan_tilt() -> None:
    (camera,) = read_robot(ROBOTS / "p2at.ini")[0].perspective_cameras
    assert camera.mount.parent == "CameraTilt"


def test_camera_when_part_of_the_omni_camera_is_no_perspective_one() -> None:
    assert read_robot(ROBOTS / "omni_p2dx.ini")[0].perspective_cameras == ()


def test_lens_when_larger_than_the_memory_limit_is_rejected_at_its_line(tmp_path: Path) -> None:
    path = tmp_path / "robot.ini"
    path.write_text(
        "[Configuration]\nBasedOn=p3at_udk.ini\n[USARSensor.USARCamera]\nResolutionX=8192\n"
        "ResolutionY=8192\n"
    )
    write_edited_copy(ROBOTS / "p3at_udk.ini", tmp_path)
    with pytest.raises(ConfigError, match=r"ResolutionX='8192 x 8192 px'.*fewer pixels.* MiB"):
        read_robots(path)
    robots, _ = read_robots(path, limit_bytes=2**34)
    assert robots[0].perspective_cameras[0].width_px == 8192


def read_effects(tmp_path: Path, *lines: str) -> EffectSettings:
    path = tmp_path / "robot.ini"
    head = ("[Configuration]", "BasedOn=p3at_udk.ini", "[USARSensor.USARCamera]")
    path.write_text("\n".join((*head, *lines)))
    write_edited_copy(ROBOTS / "p3at_udk.ini", tmp_path)
    robots, _ = read_robots(path)
    return robots[0].perspective_cameras[0].effects


def test_camera_whose_section_names_no_effect_has_none(tmp_path: Path) -> None:
    assert read_effects(tmp_path, "ResolutionX=64") == NO_EFFECT_SETTINGS


def test_camera_with_effects_has_them_by_the_keys_of_a_capture_camera(tmp_path: Path) -> None:
    found = read_effects(tmp_path, "Vignetting=auto", "ReadNoise=always", "EffectThreshold=2")
    assert [(one.effect.name, one.mode.value) for one in found.settings] == [
        ("Vignetting", "auto"),
        ("ReadNoise", "always"),
    ]
    assert found.max_change == 2.0


@pytest.mark.parametrize("kind", [kind.name for kind in EFFECT_TYPES.values() if kind.needs_mirror])
def test_camera_with_an_effect_of_mirrors_is_rejected_at_its_line(
    tmp_path: Path, kind: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        read_effects(tmp_path, f"{kind}=auto")
    text = str(caught.value)
    for part in ("robot.ini:4", f"{kind}='auto'", "a lens, which has no mirror", "Vignetting"):
        assert part in text


def test_effects_of_mirrors_are_the_five_that_a_lens_cannot_have() -> None:
    names = {kind.name for kind in EFFECT_TYPES.values() if kind.needs_mirror}
    assert names == {"MirrorDust", "MirrorHolder", "MirrorReflectance", "Misalignment", "SelfView"}
