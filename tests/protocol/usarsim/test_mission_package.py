"""Mission packages: links that follow each other; the samples are conformance vectors."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.usarsim.grammar import Dialect, parse_message
from catoptra_protocol.usarsim.mission_package import (
    LinkConfiguration,
    LinkGeometry,
    LinkStatus,
    MissionPackageConfiguration,
    MissionPackageGeometry,
    MissionPackageStatus,
)
from catoptra_protocol.usarsim.reports import Report, line_from_report, report_from_message

CENTI = st.integers(-300, 300).map(lambda value: value / 100)
VECTORS = st.tuples(CENTI, CENTI, CENTI)
STATUS = st.builds(LinkStatus, st.integers(0, 9), CENTI, CENTI)
PLACES = st.builds(LinkGeometry, st.integers(0, 9), st.integers(-1, 9), VECTORS, VECTORS)


REPORTS = st.builds(
    MissionPackageStatus, st.just(1.25), st.just("P"), st.lists(STATUS, max_size=4).map(tuple)
) | st.builds(
    MissionPackageGeometry, st.just("P"), st.lists(PLACES, min_size=1, max_size=4).map(tuple)
)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(REPORTS)
def test_report_when_written_and_read_is_the_same(report: Report) -> None:
    line = line_from_report(report).decode().rstrip()
    assert report_from_message(parse_message(line)) == report


def test_status_when_written_for_udk_has_another_word_and_no_torque() -> None:
    status = MissionPackageStatus(1.0, "P", (LinkStatus(1, 0.5, 20.0),))
    line = b"ASTA {Time 1.0000} {Name P} {Link 1} {Value 0.5000}\r\n"
    assert line_from_report(status, Dialect.UDK) == line


def test_configuration_of_a_free_joint_has_an_empty_range() -> None:
    links = (LinkConfiguration(1, 0.17, 20.0), LinkConfiguration(2, 0.1, 5.0, (-1.0, 1.0)))
    line = line_from_report(MissionPackageConfiguration("P", links))
    assert b"{MinRange 1} {MaxRange 0} {Link 2}" in line
    assert line.endswith(b"{MinRange -1.00} {MaxRange 1.00}\r\n")


BAD = [
    ("MISSTA {Time 1} {Name P} {Link 1}", "without {Value}"),
    ("MISSTA {Time 1} {Name P} {Link x} {Value 1}", "Link x"),
    ("MISSTA {Time 1} {Link 1} {Value 1}", "without {Name}"),
    ("GEO {Type MisPkg} {Name P} {Link 1} {ParentLink -1}", "without {Location}"),
]


@pytest.mark.parametrize(("line", "field_name"), BAD)
def test_package_when_malformed_names_the_field(line: str, field_name: str) -> None:
    with pytest.raises(RemoteProtocolError, match=field_name):
        report_from_message(parse_message(line))
