"""What the sections of all cameras share: mounts, settings of frames, effects."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.config.camera_sections import (
    read_effect_settings,
    read_min_frame_interval_s,
    read_mount,
    read_picture,
    read_render_settings,
)
from catoptra_server.config.robot_file import read_robot
from catoptra_server.effects import (
    EFFECT_TYPES,
    NO_EFFECT_SETTINGS,
    DecisionBasis,
    EffectMode,
    EffectSetting,
    EffectSettings,
    EffectType,
)
from catoptra_server.effects.sensor.quantisation import Quantisation
from catoptra_server.effects.sensor.read_noise import ReadNoise
from catoptra_server.render.renderer import AccuracyTarget, PerPixel
from helpers.configs import OMNI_ROBOT, ROBOTS, Edit, make_section, write_edited_copy

ITEM = "Item=(Position=(X=25,Y=0,z=-50),Direction=(Y=0,Z=16384,X=0){})"


def test_mount_when_plain_is_in_metres_on_the_chassis() -> None:
    robot = make_section(ITEM.format(""))
    mount = read_mount(robot, robot.get_struct("Item"))
    assert (mount.position_m, mount.parent) == ((25.0, 0.0, -50.0), "HARD")


def test_mount_when_by_uu_is_turned_into_metres_and_radians() -> None:
    robot = make_section(ITEM.format(',Parent="CameraTilt"'), "bMountByUU=True")
    mount = read_mount(robot, robot.get_struct("Item"))
    assert mount.position_m == pytest.approx((0.1, 0.0, -0.2))
    assert mount.rotation_rad == pytest.approx((0.0, 0.0, math.pi / 2))
    assert mount.parent == "CameraTilt"


@pytest.mark.parametrize("x", ["101", "-1e5", "1e9"])
def test_mount_when_far_from_the_robot_is_rejected(x: str) -> None:
    robot = make_section(f"Item=(Position=(X=0,Y={x}))")
    with pytest.raises(ConfigError, match=r"x\.ini:2: .*Position=.*within 100 m of its parent"):
        read_mount(robot, robot.get_struct("Item"))


def test_settings_when_missing_leave_the_choice_to_the_plan() -> None:
    section = make_section()
    settings = read_render_settings(section, surface=PerPixel(), face_size_px=0)
    assert (settings.samples, settings.face_samples, settings.face_size_px) == (0, 0, 0)
    assert settings.accuracy_target == AccuracyTarget(0.0, 0.0)
    assert read_min_frame_interval_s(section) == 0.0
    assert read_picture(section, Picture.MIRRORED) is Picture.MIRRORED


def test_settings_are_those_of_the_section() -> None:
    lines = ("Samples=3", "FaceSamples=2", "MaxErrorPx=0.5", "BudgetMs=20", "Picture=Flipped")
    section = make_section(*lines, "FrameInterval=0.1")
    settings = read_render_settings(section, surface=PerPixel(), face_size_px=256)
    assert (settings.samples, settings.face_samples, settings.face_size_px) == (3, 2, 256)
    assert settings.accuracy_target == AccuracyTarget(0.5, 20.0)
    assert read_min_frame_interval_s(section) == 0.1
    assert read_picture(section, Picture.MIRRORED) is Picture.FLIPPED


@pytest.mark.parametrize("line", ["Samples=17", "FaceSamples=9", "MaxErrorPx=-1"])
def test_setting_out_of_range_is_rejected_with_its_key(line: str) -> None:
    section = make_section(line)
    with pytest.raises(ConfigError, match=line.partition("=")[0]):
        read_render_settings(section, surface=PerPixel(), face_size_px=0)


REAL = OMNI_ROBOT.with_name("p2at_omni_real.ini")


def read_settings(path: Path) -> EffectSettings:
    camera = read_robot(path)[0].omni_camera
    assert camera is not None
    return camera.effects


def read_effects(*lines: str) -> EffectSettings:
    return read_effect_settings(make_section(*lines))


def test_robot_when_its_file_names_no_effect_has_none(tmp_path: Path) -> None:
    plain = write_edited_copy(OMNI_ROBOT, tmp_path, Edit("SelfView=auto", ""))
    assert read_settings(plain) == NO_EFFECT_SETTINGS


@pytest.mark.parametrize("name", ["p2at_omni", "omni_p2dx", "p2at_omni_scout", "p2at_omni_lab"])
def test_bundled_omnidirectional_robot_sees_itself(name: str) -> None:
    modes = {one.effect.name: one.mode for one in read_settings(ROBOTS / f"{name}.ini").settings}
    assert modes["SelfView"] is EffectMode.AUTO


def test_live_robot_sees_what_that_of_the_laboratory_sees() -> None:
    live, own = (read_robot(ROBOTS / f"p2at_omni_{name}.ini")[0] for name in ("live", "lab"))
    (seen,), (camera,) = live.omni_cameras, own.omni_cameras
    assert (seen.camera, seen.effects) == (camera.camera, camera.effects)
    assert camera.camera.width_px == 800
    assert (live.body, own.body) == ("wheels", "wheels")
    assert own.sensors != live.sensors


def test_real_robot_when_read_names_every_effect_in_optical_order() -> None:
    found = read_settings(REAL).settings
    assert [setting.effect.name for setting in found] == [*EFFECT_TYPES]
    modes = {setting.effect.name: setting.mode for setting in found}
    assert {
        modes.pop(name) for name in ("AutoExposure", "MirrorHolder", "VeilingGlare", "Response")
    } == {EffectMode.NEVER}
    assert set(modes.values()) == {EffectMode.AUTO}


def test_real_robot_when_read_leaves_no_key_unknown() -> None:
    assert read_robot(REAL)[1].unknown_names() == []


def test_number_when_several_effects_share_it_reaches_all() -> None:
    lines = ("ReadNoise=ALWAYS", "ReadNoiseElectrons=4", "FullWell=9000", "Quantisation=never")
    assert read_effects(*lines).settings == (
        EffectSetting(ReadNoise(4.0, 9000.0), EffectMode.ALWAYS),
        EffectSetting(Quantisation(12.0), EffectMode.NEVER),
    )


def test_threshold_when_given_is_the_users() -> None:
    found = read_effects("MaxChange=2", "VisibleShare=0.125", "EffectThresholdPx=0.25")
    assert (found.max_change, found.visible_share, found.threshold_px) == (2.0, 0.125, 0.25)


def test_threshold_of_an_earlier_file_allows_any_share_of_the_pixels() -> None:
    found = read_effects("EffectThreshold=2")
    assert (found.max_change, found.visible_share) == (2.0, 1.0)


@pytest.mark.parametrize("key", ["MaxChange=2", "VisibleShare=0.5"])
def test_threshold_of_both_kinds_is_rejected(key: str) -> None:
    with pytest.raises(ConfigError, match=r"EffectThreshold.*MaxChange and VisibleShare"):
        read_effects("EffectThreshold=2", key)


def test_decisions_rest_on_the_frame_unless_a_file_wants_proofs_alone() -> None:
    assert read_effects("ShotNoise=auto").basis is DecisionBasis.MEASURED
    assert read_effects("EffectDecision=Proved").basis is DecisionBasis.PROVED


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("ShotNoise=yes", "one of auto, always, never"),
        ("FullWell=0", "from 1 to"),
        ("AdcBits=32", "from 1 to 16"),
        ("EffectThreshold=-1", "from 0 to 255"),
        ("MaxChange=-1", "from 0 to 255"),
        ("MaxChange=nan", "from 0 to 255"),
        ("VisibleShare=2", "from 0 to 1"),
        ("VisibleShare=nan", "from 0 to 1"),
        ("EffectThresholdPx=inf", "from 0 to 1000"),
        ("EffectDecision=guessed", "one of proved, measured"),
    ],
)
def test_value_when_impossible_is_rejected_by_its_key(line: str, expected: str) -> None:
    with pytest.raises(ConfigError, match=expected) as error:
        read_effects(line)
    assert line.partition("=")[0] in str(error.value)


def test_diffraction_when_too_wide_to_be_drawn_is_rejected_by_its_reason() -> None:
    lens = ("FNumber=64", "Diffraction=auto")
    with pytest.raises(ConfigError, match=r"PixelPitch.*at least 4e-06 m at F/64.*952 px wide"):
        read_effects(*lens, "PixelPitch=1e-7")
    # The same pixels draw the discs of geometrical optics.
    read_effects("FNumber=64", "Defocus=auto", "PixelPitch=1e-7")
    assert read_effects(*lens, "PixelPitch=4.01e-6").settings


@pytest.mark.parametrize("kind", EFFECT_TYPES.values(), ids=lambda kind: kind.name)
def test_page_of_configurations_names_every_effect_and_its_keys(kind: EffectType) -> None:
    page = (OMNI_ROBOT.parents[1] / "README.md").read_text(encoding="utf-8")
    (row,) = (line for line in page.splitlines() if line.startswith(f"| `{kind.name}` |"))
    # `MisalignmentX`, `Y`: the common beginning of keys may be left out after the first.
    keys = row + (" the same FNumber PixelPitch FocusDistance" if "the same" in row else "")
    for parameter in kind.parameters:
        assert re.search(rf"`?{parameter.key}\b", keys) or f"`{parameter.key[12:]}`" in keys


def test_page_of_effects_names_every_one_in_order() -> None:
    page = (OMNI_ROBOT.parents[2] / "docs" / "EFFECTS.md").read_text(encoding="utf-8")
    table = page[page.index("## The effects") : page.index("## What may be left out")]
    assert re.findall(r"`([A-Z]\w+)`", table.split("|---|", 1)[1]) == [*EFFECT_TYPES]
