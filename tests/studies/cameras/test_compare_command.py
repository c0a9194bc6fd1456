"""The command `catoptra-studies compare`: rows, one real drive with a lens, table and picture."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_studies.cameras import compare_command
from catoptra_studies.cameras.camera_stage import StagedCamera


def compare(folder: Path, *words: str) -> Any:
    """Content of comparison.json."""
    assert compare_command.main([*words, "--frames", "1", "--out", str(folder)]) == 0
    return json.loads((folder / "comparison.json").read_text())


def test_unknown_world_ends_with_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--cameras", "paper", "--world", "moon", "--out", str(tmp_path)]
    with pytest.raises(SystemExit):
        compare_command.main(words)
    assert "moon" in capsys.readouterr().err


@pytest.mark.parametrize("runs", ["0", "-1"])
def test_comparison_of_no_runs_is_an_error_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], runs: str
) -> None:
    words = ["--cameras", "paper", "--runs", runs, "--out", str(tmp_path)]
    with pytest.raises(SystemExit):
        compare_command.main(words)
    assert capsys.readouterr().err.count("\n") == 1
    assert not (tmp_path / "comparison.png").exists()


def test_world_without_landmarks_is_compared_without_drives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cameras = ("--cameras", "equidistant_220,orthographic_170", "--world", "incidence_rings")
    lens, narrow = compare(tmp_path, *cameras, "--size", "60")
    assert (lens["camera"], narrow["camera"]) == ("equidistant_220", "orthographic_170")
    px_per_deg = 60 / 220
    assert lens["floor_radial"] == pytest.approx(px_per_deg)
    assert lens["horizon_tangential"] == pytest.approx(px_per_deg * 0.5 * math.pi)
    theta_deg = math.degrees(math.atan2(3.0, 0.6))
    expected = px_per_deg * theta_deg / math.degrees(math.sin(math.radians(theta_deg)))
    assert lens["floor_tangential"] == pytest.approx(expected, rel=1e-6)
    assert narrow["horizon_radial"] is None
    # The table has a dash for no value: both of the horizon, and five of drives.
    *_, row, no_landmarks, _ = capsys.readouterr().out.splitlines()
    assert "no landmarks" in no_landmarks
    assert row.startswith("| orthographic_170")
    assert row.count(" - ") == 7
    assert "6.86" in row
    with (tmp_path / "comparison.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["camera"] for row in rows] == ["equidistant_220", "orthographic_170"]
    assert float(rows[1]["floor_tangential"]) == narrow["floor_tangential"]
    assert (tmp_path / "comparison.png").stat().st_size > 5000


def test_hanging_lens_localizes_the_robot(tmp_path: Path) -> None:
    (row,) = compare(tmp_path, "--cameras", "equidistant_220", "--runs", "1")
    # Of one run there is no interval.
    assert row["ekf_p90_m_low"] is None
    # The paper's mirror at 360 px has 0.10 m, odometry alone more than 1 m.
    assert row["ekf_p90_m"] < 0.2
    assert row["steps_with_landmarks"] > 0.95


def test_cameras_are_compared_in_pairs_of_runs_with_intervals(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    errors_m = {"paper": 0.05, "equidistant_220": 0.02, "orthographic_170": 0.02}

    def drive(_stage: object, staged: StagedCamera, _parsed: object) -> dict[str, Floats]:
        runs = np.arange(20.0)
        # Two of the cameras are better in every other run.
        sign = -1.0 if staged.file.name == "orthographic_170" else 1.0
        error_m = errors_m[staged.file.name] + 1e-3 * sign * (-1.0) ** runs + 1e-5 * runs
        return dict.fromkeys(compare_command._DRIVE_KEYS, error_m)

    monkeypatch.setattr(compare_command, "_drive_with_camera", drive)
    row, *_ = compare(tmp_path, "--cameras", ",".join(errors_m), "--size", "60")
    assert row["ekf_mean_m_low"] < row["ekf_mean_m"] < row["ekf_mean_m_high"]
    text = " ".join(capsys.readouterr().out.split())
    assert "0.0501 [0.0491, 0.0511]" in text
    assert "By the paper's filter, 2 of 3 pairs of cameras differ at the level 0.05" in text
    assert "equidistant_220 below paper | 20 of 20 runs (84% to 100%)" in text
    assert "equidistant_220 below orthographic_170" not in text
    assert (tmp_path / "comparison.md").read_text().count("below paper") == 4


def test_floor_that_deck_and_capture_camera_hide_is_in_the_blind_zone(tmp_path: Path) -> None:
    words = ("--cameras", "paper,equidistant_220", "--world", "incidence_rings", "--size", "360")
    mirror, lens = compare(tmp_path, *words)
    # The deck's corners, 0.309 m below the viewpoint, 0.327 m from the axis: 0.636 m on the floor
    # 0.6 m below. A pixel of 0.66 degrees is 9 mm there.
    for row in (mirror, lens):
        assert row["blind_radius_m"] == pytest.approx(0.636, abs=0.009)
