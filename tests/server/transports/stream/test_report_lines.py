"""Lines of reports, made once for all clients that read the same report."""

from __future__ import annotations

import dataclasses

import pytest

from catoptra_protocol.errors import LocalProtocolError
from catoptra_protocol.usarsim.reports import OdometryReading, Report, VehicleStatus
from catoptra_server.serve.stream import session as report_lines
from catoptra_server.serve.stream.session import ReportLines, lines_from_reports

ODOMETRY = OdometryReading("Odometry", 1.0, 2.0, 0.5)
STATUS = VehicleStatus(1.0, 100)


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Report]:
    """Reports whose lines were made."""
    reports: list[Report] = []
    make_line = report_lines.line_from_report

    def record(report: Report) -> bytes:
        reports.append(report)
        return make_line(report)

    monkeypatch.setattr(report_lines, "line_from_report", record)
    return reports


def test_lines_are_those_of_the_control_port_without_ends() -> None:
    lines = ReportLines().get([ODOMETRY, STATUS])
    assert lines == lines_from_reports([ODOMETRY, STATUS])
    assert [line.split()[0] for line in lines] == ["SEN", "STA"]
    assert not any(line.endswith(("\r", "\n")) for line in lines)


def test_line_of_the_same_report_is_made_once(made: list[Report]) -> None:
    lines = ReportLines()
    assert lines.get([ODOMETRY, STATUS]) == lines.get([ODOMETRY, STATUS])
    assert made == [ODOMETRY, STATUS]


def test_line_of_another_report_is_made_though_equal(made: list[Report]) -> None:
    lines = ReportLines()
    for x_m in range(50):
        # Each report is dropped at once: a later one may have its address.
        report = dataclasses.replace(ODOMETRY, x_m=float(x_m))
        assert f"{x_m}.0000," in lines.get([report])[0]
    assert len(made) == 50


def test_lines_when_many_are_read_are_limited() -> None:
    lines = ReportLines()
    for number in range(1000):
        lines.get([dataclasses.replace(ODOMETRY, x_m=float(number))])
    assert len(lines) == 256


def test_report_without_a_valid_line_is_left_out(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(report: Report) -> bytes:
        raise LocalProtocolError("not finite")

    monkeypatch.setattr(report_lines, "line_from_report", refuse)
    assert ReportLines().get([ODOMETRY]) == ()
    assert "not sent: not finite" in caplog.text
