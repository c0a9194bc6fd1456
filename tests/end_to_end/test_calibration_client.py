"""`catoptra-client calibration` against a server process."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from catoptra_client.__main__ import main
from catoptra_protocol.calibration.calibration_files import camera_from_file
from catoptra_protocol.calibration.model_fits import compute_residual
from catoptra_server.commands.calibration import main as write_robot_calibration
from helpers.configs import OMNI_ROBOT
from helpers.server_process import RunningServer, start_server


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder = tmp_path_factory.mktemp("calibration")
    with start_server(folder, "--clock", "lockstep", robot=OMNI_ROBOT) as running:
        yield running
        assert running.terminate() == 0


def test_calibration_of_a_server_s_camera_is_that_of_its_robot_file(
    server: RunningServer, tmp_path: Path
) -> None:
    words = ["calibration", "--out", str(tmp_path / "client"), "--stream-port"]
    assert main([*words, str(server.stream_port)]) == 0
    assert (
        write_robot_calibration(["--robot", str(OMNI_ROBOT), "--out", str(tmp_path / "server")])
        == 0
    )
    names = {path.name for path in (tmp_path / "server").iterdir()}
    assert {path.name for path in (tmp_path / "client").iterdir()} == names
    assert len(names) > 10
    cameras = [
        camera_from_file(tmp_path / side / "kalibr_omni.yaml") for side in ("client", "server")
    ]
    # Lengths of the wire have nine digits.
    assert compute_residual(*cameras).max_px < 1e-6


def test_calibration_of_an_unknown_camera_is_a_message(
    server: RunningServer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["calibration", "--out", str(tmp_path), "--camera", "None", "--stream-port"]
    assert main([*words, str(server.stream_port)]) == 1
    assert "catoptra-client calibration: " in capsys.readouterr().err
