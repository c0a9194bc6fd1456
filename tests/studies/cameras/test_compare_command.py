"""The command `catoptra-studies compare`: rows, one real drive with a lens, table and picture."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import pytest

from catoptra_studies.cameras import compare_command


def compare(folder: Path, *words: str) -> Any:
    """Content of comparison.json."""
    assert compare_command.main([*words, "--frames", "1", "--output", str(folder)]) == 0
    return json.loads((folder / "comparison.json").read_text())


def test_world_without_landmarks_is_compared_without_drives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    compare(tmp_path, "--cameras", "paper", "--world", "incidence_rings", "--size", "60")
    assert "no landmarks" in capsys.readouterr().out


def test_unknown_world_ends_with_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--cameras", "paper", "--world", "moon", "--output", str(tmp_path)]
    assert compare_command.main(words) == 2
    assert "moon" in capsys.readouterr().err


def test_comparison_without_runs_has_numbers_of_the_models_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cameras = ("--cameras", "equidistant_220,orthographic_170")
    lens, narrow = compare(tmp_path, *cameras, "--size", "60", "--runs", "0")
    assert (lens["camera"], narrow["camera"]) == ("equidistant_220", "orthographic_170")
    px_per_deg = 60 / 220
    assert lens["floor_radial"] == pytest.approx(px_per_deg)
    assert lens["horizon_tangential"] == pytest.approx(px_per_deg * 0.5 * math.pi)
    theta_deg = math.degrees(math.atan2(3.0, 0.6))
    expected = px_per_deg * theta_deg / math.degrees(math.sin(math.radians(theta_deg)))
    assert lens["floor_tangential"] == pytest.approx(expected, rel=1e-6)
    assert narrow["horizon_radial"] is None
    # The table has a dash for no value: both of the horizon, and five of drives.
    *_, row, _ = capsys.readouterr().out.splitlines()
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
    # The paper's mirror at 360 px has 0.10 m, odometry alone more than 1 m.
    assert row["ekf_p90_m"] < 0.2
    assert row["steps_with_landmarks"] > 0.95
