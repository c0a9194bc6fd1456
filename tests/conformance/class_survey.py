"""The robot class and the start pose for the suite, from what the server has.

A USARSim server neither lists its classes nor replies to an unknown one: the known ones are tried.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass

from conformance.check import CheckFailed, CheckSkipped, ServerUnderTest
from conformance.control_session import connect_control

# Classes of UT2004, of UDK and ours; those that usually have most sensors first.
KNOWN_CLASSES = tuple(
    f"USARBot.{name}"
    for name in ("OmniP2AT", "OmniP2DX", "P2AT", "P3AT", "P2DX", "Kenaf", "Zerg", "Tarantula")
)
# The first report of a robot comes at once; a class that the server lacks costs this time.
_SPAWN_TIMEOUT_S = 1.5
_SENSORS = {"groundtruth", "odometry", "encoder", "rangescanner", "sonar"}
_DEFAULT_POSE = "{Location 0,0,0}"


@dataclass(frozen=True, slots=True)
class SurveyedClass:
    """A class that spawns."""

    name: str
    sensors: frozenset[str]
    """Those of its sensors that checks use."""
    has_camera: bool
    has_omni_camera: bool


def find_start_pose(server: ServerUnderTest) -> str:
    """Blocks of INIT with the first start pose of the server, or else the origin."""
    with connect_control(server) as session:
        try:
            session.query()
        except CheckFailed:
            return _DEFAULT_POSE
        for line in session.lines:
            if line.message.get("StartPoses") is not None and len(line.message.pairs) > 1:
                # `{Name x,y,z ...}` or, as MOAST has it, `{Name NAME Location x,y,z ...}`.
                key, value = line.message.pairs[1]
                return f"{{Start {value.partition(' ')[0] if key == 'Name' else key}}}"
    return _DEFAULT_POSE


def survey_classes(server: ServerUnderTest) -> Iterator[SurveyedClass]:
    """Classes that spawn, of the known ones, each tried for a moment."""
    for name in KNOWN_CLASSES:
        surveyed = _survey_class(dataclasses.replace(server, robot_class=name))
        if surveyed is not None:
            yield surveyed


def choose_classes(server: ServerUnderTest) -> tuple[str, str]:
    """Class with the most sensors, and the one with the most general camera."""
    found: list[SurveyedClass] = []
    for surveyed in survey_classes(server):
        found.append(surveyed)
        # The others need not be tried.
        if surveyed.sensors == _SENSORS and surveyed.has_omni_camera:
            return surveyed.name, surveyed.name
    if not found:
        return KNOWN_CLASSES[0], KNOWN_CLASSES[0]
    most_sensors = max(found, key=lambda one: len(one.sensors))
    best_camera = max(found, key=lambda one: (one.has_omni_camera, one.has_camera))
    return most_sensors.name, best_camera.name


def _survey_class(server: ServerUnderTest) -> SurveyedClass | None:
    """Sensors and cameras of a class; None if no robot of it spawns."""
    try:
        with connect_control(server) as session:
            session.send(f"INIT {{ClassName {server.robot_class}}} {server.spawn_pose}")
            if not session.read_until(
                lambda: any(line.message.word == "STA" for line in session.lines), _SPAWN_TIMEOUT_S
            ):
                return None
            types = {line.sensor_type for line in session.lines}
            cameras = [one for one in session.query("GETCONF {Type Camera}") if one.get("Name")]
    except (CheckFailed, CheckSkipped, OSError):
        return None
    return SurveyedClass(
        server.robot_class,
        frozenset(types & _SENSORS),
        bool(cameras),
        any(camera.get("Mirror") or camera.get("Lens") for camera in cameras),
    )
