"""RES: meaning of each form, and none in UDK; the samples are conformance vectors."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import RemoteProtocolError
from catoptra_protocol.usarsim.command_results import (
    CAMERA_DISABLED,
    CAMERA_MISSING,
    STATUS_FAILED,
    CameraFov,
    CameraResult,
    CommandResult,
    Viewport,
    ViewportsResult,
    result_from_message,
)
from catoptra_protocol.usarsim.grammar import Dialect, parse_message
from catoptra_protocol.usarsim.reports import Report, line_from_report

RESULTS: list[Report] = [
    CommandResult(1.25, "Odometry", "Odometry"),
    CommandResult(1.25, "Kettle", "", STATUS_FAILED),
    CameraResult(1.25, (CameraFov("A", 0.5), CameraFov("B", 1.5, STATUS_FAILED))),
    ViewportsResult(
        1.25,
        "QuadView",
        (Viewport("A"), Viewport(CAMERA_MISSING, STATUS_FAILED)) * 2,
        STATUS_FAILED,
    ),
]


@pytest.mark.parametrize("result", RESULTS, ids=str)
def test_result_when_written_and_read_is_the_same_and_has_no_line_in_udk(result: Report) -> None:
    line = line_from_report(result).decode().rstrip()
    assert result_from_message(parse_message(line)) == result
    assert line_from_report(result, Dialect.UDK) == b""


def test_result_of_a_step_exists_in_udk_too_with_four_decimals() -> None:
    line = line_from_report(CommandResult(0.02, "Step", "Clock"), Dialect.UDK)
    assert line == b"RES {Time 0.0200} {Type Step} {Name Clock} {Status OK}\r\n"


def test_viewports_by_default_are_disabled() -> None:
    assert [viewport.camera for viewport in ViewportsResult(0.0, "A").viewports] == [
        CAMERA_DISABLED
    ] * 4


BAD = [
    ("RES {Time 1} {Type Camera} {Name C} {FOV wide} {Status OK}", "FOV wide"),
    ("RES {Time 1} {Type Camera} {Name C} {FOV 1}", "without {Status}"),
    ("RES {Time 1} {Type Viewports} {Config SingleView}", "without {Status}"),
    ("RES {Type Camera} {Name C} {Status Failed}", "without {Time}"),
]


@pytest.mark.parametrize(("line", "field_name"), BAD)
def test_result_when_malformed_names_the_field(line: str, field_name: str) -> None:
    with pytest.raises(RemoteProtocolError, match=field_name):
        result_from_message(parse_message(line))
