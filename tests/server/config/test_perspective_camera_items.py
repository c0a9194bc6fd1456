"""Perspective cameras of robot files."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.robot_file import read_robot, read_robots
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.effect import NO_EFFECT_SETTINGS, EffectSettings
from helpers.configs import ROBOTS, write_edited_copy


def test_camera_when_of_the_real_udk_line_has_its_class_s_numbers() -> None:
    (camera,) = read_robot(ROBOTS / "p3at_udk.ini")[0].perspective_cameras
    assert (camera.name, camera.mount.position_m) == ("Camera", (0.1005, 0.0, -0.42))
    assert (camera.fov_rad, camera.min_fov_rad, camera.max_fov_rad) == (1.3963, 0.3491, 2.0944)


def test_camera_when_of_the_p2at_sits_on_its_pan_tilt() -> None:
    (camera,) = read_robot(ROBOTS / "p2at.ini")[0].perspective_cameras
    assert camera.mount.parent == "CameraTilt"


def test_camera_when_part_of_the_omni_camera_is_no_perspective_one() -> None:
    assert read_robot(ROBOTS / "omni_p2dx.ini")[0].perspective_cameras == ()


def test_camera_when_larger_than_the_memory_limit_is_rejected_at_its_line(tmp_path: Path) -> None:
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
    assert found.threshold_grey_levels == 2.0


@pytest.mark.parametrize("kind", [kind.name for kind in EFFECT_TYPES if kind.needs_mirror])
def test_camera_with_an_effect_of_mirrors_is_rejected_at_its_line(
    tmp_path: Path, kind: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        read_effects(tmp_path, f"{kind}=auto")
    text = str(caught.value)
    for part in ("robot.ini:4", f"{kind}='auto'", "a lens, which has no mirror", "Vignetting"):
        assert part in text


def test_effects_of_mirrors_are_the_four_that_a_lens_cannot_have() -> None:
    names = {kind.name for kind in EFFECT_TYPES if kind.needs_mirror}
    assert names == {"MirrorDust", "MirrorReflectance", "Misalignment", "SelfView"}
