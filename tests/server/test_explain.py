from __future__ import annotations

import json

import pytest

from catoptra_server.effects import EFFECTS
from catoptra_server.explain import main

QUESTION = ["--world", "incidence_rings", "--renderer", "trace"]


def test_camera_when_its_file_names_effects_is_explained_row_by_row(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--robot", "p2at_omni_real", *QUESTION]) == 0
    head, _, *rows, cost = capsys.readouterr().out.splitlines()
    assert head.startswith("USARBot.OmniP2AT OmniCamPillar_Link4: trace")
    names = [row.split()[0] for row in rows]
    assert names == [kind.name for kind in EFFECTS if kind.name in names], "in optical order"
    assert {"Fog", "Vignetting", "ShotNoise"} <= set(names)
    assert any("a converter of 12 bits" in row and " off " in row for row in rows)
    assert cost.startswith("a frame takes ")


def test_camera_when_its_file_names_none_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--robot", "p2at_omni", *QUESTION]) == 0
    assert "no effects: the robot's file names none" in capsys.readouterr().out


def test_explanation_when_asked_for_as_json_has_the_same_decisions(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--robot", "p2at_omni_real", *QUESTION, "--pose", "0.5,0,1", "--json"]) == 0
    (told,) = json.loads(capsys.readouterr().out)
    assert {one["effect"] for one in told["effects"] if one["is_on"]} == set(told["ms"])
    assert told["others_ms"] > 0.0


def test_robot_when_it_has_no_such_camera_is_no_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--robot", "p2at", *QUESTION]) == 0
    assert capsys.readouterr().out == "no robot has an omnidirectional camera\n"


def test_file_when_it_is_not_there_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--robot", "nobody.ini", *QUESTION]) == 2
    assert "nobody.ini" in capsys.readouterr().err


@pytest.mark.parametrize("pose", ["1,2", "a,b,c", "1,2,nan"])
def test_pose_when_it_is_none_is_refused(pose: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--robot", "p2at_omni", *QUESTION, "--pose", pose])
    assert "pose" in capsys.readouterr().err
