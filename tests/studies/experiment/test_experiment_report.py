"""The report is one file: figures inside, every claim, the parameters' table, text escaped."""

from __future__ import annotations

import base64
import re
from configparser import ConfigParser

import cv2
import numpy as np
import pytest

from catoptra_studies.experiment.experiment_report import (
    ODOMETRY_ERRORS,
    format_page_block,
    write_html_report,
)
from catoptra_studies.experiment.experiment_setups import FILTERS, PAPER_FILTER, SETUPS
from catoptra_studies.experiment.metrics import summarize_runs
from catoptra_studies.experiment.paper_claims import Claim, Difference
from catoptra_studies.reports import ReportFigure
from catoptra_studies.run_statistics import RunShare
from helpers.configs import REPOSITORY
from studies.experiment.test_metrics import make_filter_run

NOTHING = {
    "measurements": 0,
    "range_error_m": {},
    "bearing_error_deg": {},
    "beacons_measured_by_distance": [{"from_m": 0.0, "to_m": 0.5, "rate": 0.25}],
}


@pytest.fixture
def report(tmp_path):
    """The text of a small report, and the bytes of its figure."""
    png = tmp_path / "a.png"
    cv2.imwrite(str(png), np.zeros((4, 4, 3), dtype=np.uint8))
    # As many filters as the experiment has.
    runs = [make_filter_run(number, largest_m=0.2 + 0.05 * number) for number in range(3)]
    filters = {settings.name: {"title": "P0 < 1", **summarize_runs(runs)} for settings in FILTERS}
    setups = {"sim": {"title": "a & b", "measurements": NOTHING, "filters": filters}}
    figure = ReportFigure("a.png", "Title", "less < more", 'the "alt"')
    path = write_html_report(
        tmp_path,
        subtitle="now",
        num_runs=1,
        claims=[
            Claim("a", "confirmed claim", "1 < 2", RunShare(15, 20)),
            Claim("b", "other claim", "2 < 1", RunShare(1, 20)),
            Claim("c", "third claim", "1 < 3", RunShare(12, 20)),
        ],
        differences=[Difference("they", "we", "because")],
        camera_figures=[figure],
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


def test_report_has_each_claim_and_its_evaluation(report):
    text, _ = report
    assert "<td>confirmed claim</td><td>1 &lt; 2</td><td>15 of 20 runs (53% to 89%)</td>" in text
    assert text.count('<td class="yes">yes</td>') == 1
    assert text.count('<td class="no">no</td>') == 1
    assert text.count('<td class="not">not decided in 20 runs</td>') == 1
    assert "<td>they</td><td>we</td><td>because</td>" in text


def test_tables_are_not_wider_than_the_page(report):
    text, _ = report
    page_px = 16 * int(re.search(r"body \{[^}]*max-width: (\d+)rem", text)[1])
    is_wrapped = "nowrap" not in text
    widths = {}
    for table in re.findall(r"<table>.*?</table>", text):
        rows = re.findall(r"<tr>(.*?)</tr>", table)
        cells = [re.findall(r"(<t[hd][^>]*>.*?)</t[hd]>", row) for row in rows]
        columns = zip(*cells, strict=True)
        widths[cells[-1][0]] = sum(_column_px(column, is_wrapped=is_wrapped) for column in columns)
    assert len(widths) == 5
    assert max(widths.values()) < page_px


def _column_px(cells, *, is_wrapped):
    # 0.64 em a character: digits of DejaVu Sans, the widest of usual fonts; padding of 0.8 em.
    parts = []
    for cell in cells:
        tag, _, content = cell.partition(">")
        parts += [content] if tag == '<td class="n"' and not is_wrapped else content.split(" ")
    return 16 * (0.64 * 0.9 * max(map(len, parts)) + 1.6)


def test_report_escapes_its_texts(report):
    text, _ = report
    assert "less &lt; more" in text
    assert 'alt="the &quot;alt&quot;"' in text
    assert "a &amp; b" in text


def test_report_shows_statistics_and_missing_values(report):
    text, _ = report
    assert "0.25 [0.205,\u00a00.295]" in text
    assert "0-0.5 m: 25%" in text
    assert text.count("none") >= 2
    assert "$" not in text


def test_report_states_the_quantile_of_the_gate_that_ran(report):
    text, _ = report
    rate = PAPER_FILTER.gate.false_rejection_rate
    assert f"exceeds the {1.0 - rate:.0%} quantile" in " ".join(text.split())


@pytest.mark.parametrize("term", ["sim", "real", "P0", "R", "gate", "odometry alone", "error"])
def test_report_explains_its_terms_before_it_uses_them(report, term):
    text, _ = report
    assert text.index(f"<dt>{term}</dt>") < text.index("<h2>Claims of the paper</h2>")


@pytest.mark.parametrize("setup", SETUPS, ids=lambda setup: setup.name)
def test_odometry_errors_are_those_of_the_robot_file(setup):
    file = ConfigParser(inline_comment_prefixes=";")
    file.optionxform = str  # type: ignore[assignment,method-assign]
    assert file.read(REPOSITORY / "configs" / "robots" / setup.robot_file)
    errors = {key: float(text) for key, text in file["USARBot.OdometrySensor"].items()}
    assert errors == ODOMETRY_ERRORS[setup.name]


@pytest.mark.parametrize(
    "text",
    ["sim 1.0°, real −5.2°", "0.40 m of the range, 2.5°", "10% of the distance, 1.32° a metre"],
)
def test_table_has_the_numbers_of_setups_and_filters(report, text):
    assert text in report[0]


def test_page_block_has_the_errors_of_each_filter():
    runs = [make_filter_run(number, largest_m=0.2 + 0.05 * number) for number in range(3)]
    filters = {one.name: {"title": one.title, **summarize_runs(runs)} for one in FILTERS}
    summary = {"seed": 4, "num_runs": 3, "setups": {"sim": {"filters": filters}}}
    text = format_page_block(summary)
    assert "seed 4, 3 runs a set-up" in text
    (row,) = (line for line in text.splitlines() if "this filter: largest" in line)
    assert row.count("0.25 [") == len(FILTERS)
