"""Mission packages on a robot: commands by number and name, MISSTA, CONF, GEO."""

from __future__ import annotations

import pytest

from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.simulation.robot_description import ANGLE, STANDARD_PACKAGES
from catoptra_server.simulation.sensors.mission_package import MissionPackage


def make_package() -> MissionPackage:
    return MissionPackage(STANDARD_PACKAGES["camerapantilt"])


def test_joint_when_commanded_moves_at_its_speed_and_arrives() -> None:
    head = make_package()
    assert head.command_joint(1, 0.1, ANGLE)
    head.step(0.5)
    assert head.joint_angles_rad() == {"camerapan": pytest.approx(0.085), "cameratilt": 0.0}
    head.step(0.5)
    assert head.joint_angles_rad()["camerapan"] == 0.1


@pytest.mark.parametrize("number", [0, 3, -1])
def test_link_when_missing_is_not_commanded(number: int) -> None:
    assert not make_package().command_joint(number, 1.0, ANGLE)


@pytest.mark.parametrize(
    ("name", "number"),
    [("cameraTILT", 2), ("CameraPanTilt_Link1", 1), ("FRFlipper", None), ("", None)],
)
def test_link_when_named_has_its_number(name: str, number: int | None) -> None:
    assert make_package().find_link_number(name) == number


def test_lines_when_sent_have_the_captured_form() -> None:
    head = make_package()
    head.command_joint(2, 1.0, ANGLE)
    head.step(0.1)
    assert line_from_report(head.status(395.38)) == (
        b"MISSTA {Time 395.38} {Name CameraPanTilt} {Link 1} {Value 0.0000} {Torque 0.00} "
        b"{Link 2} {Value 0.0170} {Torque 20.00}\r\n"
    )
    assert line_from_report(head.configuration()).startswith(
        b"CONF {Type MisPkg} {Name CameraPanTilt} {Link 1} {JointType Revolute} {MaxSpeed 0.17} "
        b"{MaxTorque 20.00} {MinRange 1} {MaxRange 0} {Link 2}"
    )
    assert line_from_report(head.geometry()) == (
        b"GEO {Type MisPkg} {Name CameraPanTilt} {Link 1} {ParentLink -1} "
        b"{Location 0.1239,0.0000,-0.2036} {Orientation 3.1415,0.0000,0.0000} {Link 2} "
        b"{ParentLink 1} {Location 0.0000,0.0000,0.0599} {Orientation 1.5707,0.0000,0.0000}\r\n"
    )
