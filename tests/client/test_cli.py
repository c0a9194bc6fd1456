"""The command catoptra-client."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import catoptra_client
from catoptra_client.__main__ import main
from catoptra_client.cli import COMMANDS
from catoptra_client.server_process import run_server
from catoptra_client.training_frames import ROBOT_CLASS


def test_command_when_interrupted_ends_with_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setitem(COMMANDS, "train", interrupt)
    assert main(["train"]) == 130
    assert capsys.readouterr().err == "catoptra-client: interrupted\n"


def test_entry_point_when_imported_has_loaded_no_library() -> None:
    code = (
        "import sys; import catoptra_client.__main__\n"
        "sys.exit(any(name in sys.modules for name in ('numpy', 'cv2', 'zmq')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_package_has_show_and_no_other_attribute() -> None:
    assert callable(catoptra_client.show)
    with pytest.raises(AttributeError, match="has no attribute 'shaw'"):
        _ = catoptra_client.shaw  # type: ignore[attr-defined]


@pytest.mark.parametrize("command", ["train", "bearings"])
def test_command_takes_any_class_of_robot(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    help_text = capsys.readouterr().out
    assert "--robot CLASS" in help_text
    assert ROBOT_CLASS in help_text


def test_bearings_are_those_of_the_named_camera_in_the_robot_s_axes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    robot, world, path = Path("p2at_fisheye"), Path("four_legged_2006"), tmp_path / "c.npz"
    with run_server(robot, world, seed=3, log_file=tmp_path / "log") as address:
        common = [
            *("--host", address.host, "--control-port", str(address.control_port)),
            *("--image-port", str(address.image_port), "--robot", "USARBot.FisheyeP2AT"),
        ]
        assert main(["train", "--out", str(path), "--training-frames", "8", *common]) == 0
        command = ["bearings", "--classifier", str(path), "--frames", "1", *common]
        command += ["--stream-port", str(address.stream_port), "--camera"]
        capsys.readouterr()
        assert main([*command, "FrontCam"]) == 0
        lines = capsys.readouterr().out.splitlines()[1:]
        bearings = {line.split()[0]: float(line.split()[1]) for line in lines}
        # The centre of the field, looking at the yellow goal: those behind are not in the picture,
        # which the hanging camera, the first one, has.
        assert bearings == pytest.approx(
            {"magenta_over_yellow": -54.6, "yellow_over_magenta": 54.6, "yellow_goal": 0.0}, abs=0.5
        )
        assert main([*command, "Nobody"]) == 1
        assert "camera 'Nobody' of USARBot.FisheyeP2AT is missing" in capsys.readouterr().err


def test_error_is_one_line_and_status_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bearings", "--classifier", str(tmp_path / "none.npz")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("catoptra-client bearings: ")
    assert "none.npz" in line
