"""`catoptra-server calibration`: files for other programs, and messages."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.model_fits import compute_residual
from catoptra_protocol.errors import ConfigError
from catoptra_server.__main__ import main
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.robot_file import read_robot
from helpers.configs import ROBOTS, write_edited_copy


def test_folder_has_the_files_and_the_report(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "made" / "here"
    assert main(["calibration", "--robot", "p2at_omni", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert f"{out / 'kalibr_omni.yaml'}: within 1.3e-13 px" in printed
    assert "not written: woodscape: off by up to 0.756 px" in printed
    names = {path.name for path in out.iterdir()}
    assert {"CALIBRATION.md", "opencv_omnidir.yaml", "basalt_ds.json", "ocamcalib.txt"} <= names
    assert "woodscape.json" not in names
    omni = read_robot(find_configuration("robots", "p2at_omni"))[0].omni_camera
    assert omni is not None
    read = camera_from_file(out / "opencv_omnidir.yaml")
    assert compute_residual(omni.camera, read).max_px < 1e-9


def test_second_run_writes_the_same_bytes(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        words = ["calibration", "--robot", "p2at_fisheye", "--out", str(tmp_path / folder)]
        assert main(words) == 0
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes()


def test_camera_too_large_to_be_drawn_is_written(tmp_path: Path) -> None:
    robot = write_edited_copy(ROBOTS / "p2at.ini", tmp_path).with_name("robot.ini")
    robot.write_text(
        "[Configuration]\nBasedOn=p2at.ini\n[USARBot.P2AT]\nCameras=(ItemClass=class'Catoptra.Eye',"
        "ItemName=Eye,Position=(X=0,Y=0,Z=-0.5))\n[Catoptra.Eye]\nLens=equidistant\nSamples=16\n"
        "FieldOfView=170\nResolutionX=1200\nResolutionY=1200\n"
    )
    with pytest.raises(ConfigError, match="MiB"):
        read_robot(robot)
    assert main(["calibration", "--robot", str(robot), "--out", str(tmp_path)]) == 0
    assert camera_from_file(tmp_path / "kalibr_equi.yaml").width_px == 1200


def test_camera_is_chosen_by_its_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["calibration", "--robot", "p2at_fisheye", "--out", str(tmp_path)]
    assert main([*words, "--camera", "frontcam"]) == 0
    assert "# Calibration of FrontCam" in (tmp_path / "CALIBRATION.md").read_text()
    capsys.readouterr()
    assert main([*words, "--camera", "Other"]) == 1
    error = capsys.readouterr().err
    assert "no omnidirectional camera Other: it has " in error
    assert "FrontCam" in error


@pytest.mark.parametrize("words", [["--max-residual-px", "few"], ["--picture", "turned"]])
def test_wrong_option_ends_with_the_usage(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["calibration", "--robot", "p2at_omni", "--out", str(tmp_path), *words])
    assert ended.value.code == 2
    assert "--help` lists the options" in capsys.readouterr().err


def test_folder_that_cannot_be_made_is_a_message(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["calibration", "--robot", "p2at_omni", "--out", str(tmp_path / "file")]) == 1
    assert "catoptra-server calibration: " in capsys.readouterr().err
