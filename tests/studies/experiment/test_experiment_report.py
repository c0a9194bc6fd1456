"""The report is one file: pictures inside, every claim with its verdict, text escaped."""

from __future__ import annotations

import base64
import re

import cv2
import numpy as np
import pytest
from client.experiment.test_ensemble import trace

from catoptra_studies.experiment.ensemble import summarise_runs
from catoptra_studies.experiment.experiment_report import Claim, ReportFigure, write_html_report

NOTHING = {
    "measurements": 0,
    "range_error_m": {},
    "bearing_error_deg": {},
    "beacons_measured_by_distance": [{"from_m": 0.0, "to_m": 0.5, "share": 0.25}],
}


@pytest.fixture
def report(tmp_path):
    """Return the text of a small report, and the bytes of its picture."""
    png = tmp_path / "a.png"
    cv2.imwrite(str(png), np.zeros((4, 4, 3), dtype=np.uint8))
    filters = {"paper": {"title": "P0 < 1", **summarise_runs([trace(0, largest_m=0.25)])}}
    setups = {"sim": {"title": "a & b", "measurements": NOTHING, "filters": filters}}
    picture = ReportFigure("a.png", "Title", "less < more", 'the "alt"')
    path = write_html_report(
        tmp_path,
        subtitle="now",
        num_runs=1,
        claims=[Claim("it holds", "1 m", True), Claim("it does not", "2 m", False)],
        camera_figures=[picture],
        landmark_figures=[],
        drive_figures=[],
        summary={"setups": setups},
        timing="0 s",
    )
    return path.read_text(encoding="utf-8"), png.read_bytes()


def test_report_is_self_contained(report):
    text, png = report
    assert base64.b64encode(png).decode() in text
    assert not re.search(r'(src|href)="(?!data:)', text)


def test_report_states_each_claim_and_whether_it_holds(report):
    text, _ = report
    assert '<td>it holds</td><td>1 m</td><td class="yes">yes</td>' in text
    assert '<td>it does not</td><td>2 m</td><td class="no">no</td>' in text


def test_report_escapes_what_it_is_given(report):
    text, _ = report
    assert "less &lt; more" in text
    assert 'alt="the &quot;alt&quot;"' in text
    assert "a &amp; b" in text


def test_report_shows_spreads_and_what_is_missing(report):
    text, _ = report
    assert "0.25 [0.25, 0.25]" in text
    assert "0-0.5 m: 25%" in text
    assert text.count("none") >= 2
    assert "$" not in text
