"""Class and start pose of servers of other makers."""

from __future__ import annotations

import pytest

from conformance.check import ServerUnderTest
from conformance.class_survey import KNOWN_CLASSES, choose_classes, find_start_pose
from conformance.conversation_file import Address
from helpers.scripted_control import Reply, serve_control_script

NO_POSES = "NFO {StartPoses 0}\r\n"
OMNI_CAMERA = "CONF {Type Camera} {Name Omni} {CameraFov 20.0} {Mirror hyperbolic}\r\n"


def server_at(address: Address) -> ServerUnderTest:
    """A server of which only the address is known."""
    return ServerUnderTest({"control": address}, "", "{Location 0,0,0}", "ut2004", False)


@pytest.mark.parametrize(
    ("reply", "expected"),
    [
        ("NFO {StartPoses 1} {Robot2 16.9,2.4,1.4 0.0,0.0,-4.7}\r\n", "{Start Robot2}"),
        (
            "NFO {StartPoses 1} {Name Unit1 Location 10.2,3.5,10.0 Orientation 0.0,0.0,1.6}\r\n",
            "{Start Unit1}",
        ),
        ("NFO {StartPoses 7} {A 1, 2, 3 0, 0, 0}\r\n", "{Start A}"),
        (NO_POSES, "{Location 0,0,0}"),
    ],
    ids=["UvA", "MOAST", "malformed", "none"],
)
def test_start_pose_when_the_reply_has_another_form_is_its_first_name(
    reply: str, expected: str
) -> None:
    with serve_control_script(lambda line: reply) as address:
        assert find_start_pose(server_at(address)) == expected


def make_reply(robots: dict[str, str], cameras: str = "") -> Reply:
    """Reply of a server whose classes report these lines; all of them have the same cameras."""

    def reply(line: str) -> str:
        if line == "GETSTARTPOSES":
            return NO_POSES
        if line.startswith("GETCONF"):
            return cameras
        return next((text for name, text in robots.items() if f"ClassName {name}}}" in line), "")

    return reply


def test_classes_when_two_spawn_are_the_one_with_more_sensors() -> None:
    few, many = KNOWN_CLASSES[0], KNOWN_CLASSES[1]
    status = "STA {Type GroundVehicle} {Time 1.00}\r\n"
    odometry = "SEN {Type Odometry} {Name O} {Pose 0,0,0}\r\n"
    scan = "SEN {Time 1.00} {Type RangeScanner} {Name S} {Range 1.0}\r\n"
    # A class that the server lacks has no reply: the survey of all others would take seconds.
    robots = dict.fromkeys(KNOWN_CLASSES, status) | {
        few: odometry + status,
        many: odometry + scan + status,
    }
    with serve_control_script(make_reply(robots, OMNI_CAMERA)) as address:
        assert choose_classes(server_at(address)) == (many, few)


def test_classes_when_none_spawns_are_the_first_known_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("conformance.class_survey._SPAWN_TIMEOUT_S", 0.01)
    with serve_control_script(make_reply({})) as address:
        assert choose_classes(server_at(address)) == (KNOWN_CLASSES[0], KNOWN_CLASSES[0])
