"""What the sections of all omnidirectional cameras have."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.config.camera_sections import (
    read_min_frame_interval_s,
    read_picture,
    read_render_settings,
)
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.render.render_settings import AccuracyTarget, PerPixel


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
