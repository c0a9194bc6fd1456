"""Mounts of robot files: metres, Unreal units, parents.

What the sections of all omnidirectional cameras have.

Texture clients: five faces and, where the file has it, the sixth."""

from __future__ import annotations

import logging
import math
import re
from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.config.camera_sections import (
    read_effect_settings,
    read_min_frame_interval_s,
    read_mount,
    read_picture,
    read_render_settings,
    read_texture_clients,
)
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.unreal_ini import parse_sections
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.effect import (
    NO_EFFECT_SETTINGS,
    DecisionBasis,
    EffectMode,
    EffectSetting,
    EffectSettings,
    EffectType,
)
from catoptra_server.effects.sensor.quantisation import Quantisation
from catoptra_server.effects.sensor.read_noise import ReadNoise
from catoptra_server.render.render_settings import AccuracyTarget, PerPixel
from helpers.configs import OMNI_ROBOT, ROBOTS, Edit, write_edited_copy

ITEM = "Item=(Position=(X=25,Y=0,z=-50),Direction=(Y=0,Z=16384,X=0){})"


def make_robot_section(*lines: str) -> SectionReader:
    (section,) = parse_sections("\n".join(("[R]", *lines)), file="x.ini")
    return SectionReader(section.name, section.where, section.entries)


def test_mount_when_plain_is_in_metres_on_the_chassis() -> None:
    robot = make_robot_section(ITEM.format(""))
    mount = read_mount(robot, robot.get_struct("Item"))
    assert (mount.position_m, mount.parent) == ((25.0, 0.0, -50.0), "HARD")


def test_mount_when_by_uu_is_turned_into_metres_and_radians() -> None:
    robot = make_robot_section(ITEM.format(',Parent="CameraTilt"'), "bMountByUU=True")
    mount = read_mount(robot, robot.get_struct("Item"))
    assert mount.position_m == pytest.approx((0.1, 0.0, -0.2))
    assert mount.rotation_rad == pytest.approx((0.0, 0.0, math.pi / 2))
    assert mount.parent == "CameraTilt"


@pytest.mark.parametrize("x", ["101", "-1e5", "1e9"])
def test_mount_when_far_from_the_robot_is_rejected(x: str) -> None:
    robot = make_robot_section(f"Item=(Position=(X=0,Y={x}))")
    with pytest.raises(ConfigError, match=r"x\.ini:2: .*Position=.*within 100 m of its parent"):
        read_mount(robot, robot.get_struct("Item"))


def read_section(folder: Path, *lines: str) -> SectionReader:
    path = folder / "camera.ini"
    path.write_text("\n".join(("[Catoptra.Eye]", *lines, "")))
    return IniFile(path).get_section("Catoptra.Eye")


def test_settings_when_missing_leave_the_choice_to_the_plan(tmp_path: Path) -> None:
    section = read_section(tmp_path)
    settings = read_render_settings(section, surface=PerPixel(), face_size_px=0)
    assert (settings.samples, settings.face_samples, settings.face_size_px) == (0, 0, 0)
    assert settings.accuracy_target == AccuracyTarget(0.0, 0.0)
    assert read_min_frame_interval_s(section) == 0.0
    assert read_picture(section, Picture.MIRRORED) is Picture.MIRRORED


def test_settings_are_those_of_the_section(tmp_path: Path) -> None:
    lines = ("Samples=3", "FaceSamples=2", "MaxErrorPx=0.5", "BudgetMs=20", "Picture=Flipped")
    section = read_section(tmp_path, *lines, "FrameInterval=0.1")
    settings = read_render_settings(section, surface=PerPixel(), face_size_px=256)
    assert (settings.samples, settings.face_samples, settings.face_size_px) == (3, 2, 256)
    assert settings.accuracy_target == AccuracyTarget(0.5, 20.0)
    assert read_min_frame_interval_s(section) == 0.1
    assert read_picture(section, Picture.MIRRORED) is Picture.FLIPPED


@pytest.mark.parametrize("line", ["Samples=17", "FaceSamples=9", "MaxErrorPx=-1"])
def test_setting_out_of_range_is_rejected_with_its_key(tmp_path: Path, line: str) -> None:
    section = read_section(tmp_path, line)
    with pytest.raises(ConfigError, match=line.partition("=")[0]):
        read_render_settings(section, surface=PerPixel(), face_size_px=0)


def write_clients(folder: Path, faces: str, line: str = "FOV=90") -> IniFile:
    path = folder / "clients.ini"
    path.write_text("".join(f"[USARBot.USARCameraTextureClient{f}]\n{line}\n" for f in faces))
    return IniFile(path)


def test_clients_have_the_size_and_texture_of_their_sections(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    clients = read_texture_clients(write_clients(tmp_path, "NESWCU", "TextureSize=64"))
    assert [client.face for client in clients] == list(Face)
    assert {client.size_px for client in clients} == {64}
    assert clients[0].texture == "OmniCamN"
    assert clients[0].fov_rad == pytest.approx(math.pi / 2)
    assert not caplog.messages


def test_clients_without_sections_are_named_once(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.WARNING):
        clients = read_texture_clients(write_clients(tmp_path, "NSC"))
    assert len(clients) == 5, "the sixth is optional"
    (message,) = caplog.messages
    assert "[USARBot.USARCameraTextureClientE], [USARBot.USARCameraTextureClientW]" in message


def test_client_with_another_angle_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="90: the faces of a cube"):
        read_texture_clients(write_clients(tmp_path, "NESWC", "FOV=80"))


REAL = OMNI_ROBOT.with_name("p2at_omni_real.ini")


def read_settings(path: Path) -> EffectSettings:
    camera = read_robot(path)[0].omni_camera
    assert camera is not None
    return camera.effects


def make_section(tmp_path: Path, *lines: str) -> EffectSettings:
    path = tmp_path / "robot.ini"
    path.write_text("\n".join(("[Camera]", *lines)), encoding="utf-8")
    return read_effect_settings(IniFile(path).get_section("Camera"))


def test_robot_when_its_file_names_no_effect_has_none(tmp_path: Path) -> None:
    plain = write_edited_copy(OMNI_ROBOT, tmp_path, Edit("SelfView=auto", ""))
    assert read_settings(plain) == NO_EFFECT_SETTINGS


@pytest.mark.parametrize("name", ["p2at_omni", "omni_p2dx", "p2at_omni_scout", "p2at_omni_live"])
def test_bundled_omnidirectional_robot_sees_itself(name: str) -> None:
    modes = {one.effect.name: one.mode for one in read_settings(ROBOTS / f"{name}.ini").settings}
    assert modes["SelfView"] is EffectMode.AUTO


def test_real_robot_when_read_names_every_effect_in_optical_order() -> None:
    found = read_settings(REAL).settings
    assert [setting.effect.name for setting in found] == [kind.name for kind in EFFECT_TYPES]
    modes = {setting.effect.name: setting.mode for setting in found}
    assert modes.pop("AutoExposure") is EffectMode.NEVER
    assert set(modes.values()) == {EffectMode.AUTO}


def test_real_robot_when_read_leaves_no_key_unknown() -> None:
    assert read_robot(REAL)[1].unknown_names() == []


def test_number_when_several_effects_share_it_reaches_all(tmp_path: Path) -> None:
    lines = ("ReadNoise=ALWAYS", "ReadNoiseElectrons=4", "FullWell=9000", "Quantisation=never")
    assert make_section(tmp_path, *lines).settings == (
        EffectSetting(ReadNoise(4.0, 9000.0), EffectMode.ALWAYS),
        EffectSetting(Quantisation(12.0), EffectMode.NEVER),
    )


def test_threshold_when_given_is_the_users(tmp_path: Path) -> None:
    found = make_section(tmp_path, "EffectThreshold=2", "EffectThresholdPx=0.25")
    assert (found.threshold_grey_levels, found.threshold_px) == (2.0, 0.25)


def test_decisions_rest_on_the_frame_unless_a_file_wants_proofs_alone(tmp_path: Path) -> None:
    assert make_section(tmp_path, "ShotNoise=auto").basis is DecisionBasis.MEASURED
    assert make_section(tmp_path, "EffectDecision=Proved").basis is DecisionBasis.PROVED


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("ShotNoise=yes", "one of auto, always, never"),
        ("FullWell=0", "from 1 to"),
        ("AdcBits=32", "from 1 to 16"),
        ("EffectThreshold=-1", "from 0 to 255"),
        ("EffectThresholdPx=inf", "from 0 to 1000"),
        ("EffectDecision=guessed", "one of proved, measured"),
    ],
)
def test_value_when_impossible_is_rejected_by_its_key(
    tmp_path: Path, line: str, expected: str
) -> None:
    with pytest.raises(ConfigError, match=expected) as error:
        make_section(tmp_path, line)
    assert line.partition("=")[0] in str(error.value)


def test_diffraction_when_too_wide_to_be_drawn_is_rejected_by_its_reason(tmp_path: Path) -> None:
    lens = ("FNumber=64", "Diffraction=auto")
    with pytest.raises(ConfigError, match=r"PixelPitch.*at least 4e-06 m at F/64.*952 px wide"):
        make_section(tmp_path, *lens, "PixelPitch=1e-7")
    # The same pixels draw the discs of geometrical optics.
    make_section(tmp_path, "FNumber=64", "Defocus=auto", "PixelPitch=1e-7")
    assert make_section(tmp_path, *lens, "PixelPitch=4.01e-6").settings


@pytest.mark.parametrize("kind", EFFECT_TYPES, ids=lambda kind: kind.name)
def test_page_of_configurations_names_every_effect_and_its_keys(kind: EffectType) -> None:
    page = (OMNI_ROBOT.parents[1] / "README.md").read_text(encoding="utf-8")
    (row,) = (line for line in page.splitlines() if line.startswith(f"| `{kind.name}` |"))
    # `MisalignmentX`, `Y`: the common beginning of keys may be left out after the first.
    keys = row + (" the same FNumber PixelPitch FocusDistance" if "the same" in row else "")
    for parameter in kind.parameters:
        assert re.search(rf"`?{parameter.key}\b", keys) or f"`{parameter.key[12:]}`" in keys


def test_page_of_effects_names_every_one_in_order() -> None:
    page = (OMNI_ROBOT.parents[2] / "docs" / "EFFECTS.md").read_text(encoding="utf-8")
    table = page[page.index("## The effects") : page.index("## Add an effect")]
    assert re.findall(r"`([A-Z]\w+)`", table.split("|---|", 1)[1]) == [k.name for k in EFFECT_TYPES]
