"""The command `catoptra-studies ramps`: a short experiment, its table and its pictures."""

from __future__ import annotations

import re

import numpy as np
import pytest

from catoptra_studies.cli import main


def test_roll_and_pitch_of_the_ins_restore_bearings_ranges_and_filters(tmp_path, capsys):
    page = tmp_path / "docs" / "page.md"
    page.parent.mkdir()
    page.write_text("<!-- ramps: begin -->\n<!-- ramps: end -->\n", encoding="utf-8")
    words = ("--quick", "--runs", "2", "--out", str(tmp_path / "out"), "--page", str(page))
    assert main(["ramps", *words]) == 0
    # Fewer than six runs have no intervals.
    rows = re.findall(r"^\| (\d+)°, .*? \|(.*)\|$", page.read_text(encoding="utf-8"), re.MULTILINE)
    assert [row[0] for row in rows] == ["0"] * 3 + ["20"] * 3
    numbers = np.array([[float(cell) for cell in row[1].split("|")] for row in rows])
    flat, flat_by_ins, _, steep, by_ins, noisy = numbers
    # On a level floor the INS changes nothing; on the slope errors are again near those there.
    assert flat_by_ins == pytest.approx(flat)
    found, bearing_deg, range_m, *filters_m = range(5)
    assert min(steep[found], by_ins[found]) > 85.0
    assert steep[bearing_deg] > 1.5
    assert by_ins[bearing_deg] < noisy[bearing_deg] < 0.6
    assert steep[range_m] > 4.0 * flat[range_m]
    assert by_ins[range_m] < 2.0 * flat[range_m]
    for filter_m in filters_m:
        assert steep[filter_m] > 1.5 * flat[filter_m]
        assert max(by_ins[filter_m], noisy[filter_m]) < 1.5 * flat[filter_m]
    for name in ("ramps.png", "ramps-horizon.png"):
        assert 10_000 < (page.parent / name).stat().st_size < 150_000
    assert "20°, taken for level" in capsys.readouterr().out
