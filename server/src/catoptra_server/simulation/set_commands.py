"""SET: what a part of a robot can be told, and the RES that confirms it or says Failed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from catoptra_protocol.errors import DomainError
from catoptra_protocol.usarsim.command_results import STATUS_FAILED, STATUS_OK
from catoptra_protocol.usarsim.commands import Set
from catoptra_protocol.usarsim.reports import (
    CameraFov,
    CameraResult,
    CommandResult,
    Report,
)
from catoptra_server.sensors import SensorContext
from catoptra_server.sensors.encoder import EncoderBank
from catoptra_server.sensors.ins import InsSensor
from catoptra_server.sensors.odometry import OdometrySensor
from catoptra_server.sensors.range_scanner import RangeScannerSensor
from catoptra_server.simulation.robot import Robot


def execute_set(robot: Robot, command: Set, moment: SensorContext) -> list[Report]:
    """Carry out SET of a part; return its RES, after the reading that SCAN asks for."""
    if command.type.lower() == "camera" and command.parse_fov_rad() is not None:
        return [_zoom(robot, command, moment.time_s)]
    handler = _HANDLERS.get((command.type.lower(), (command.opcode or "").lower()))
    extra: Sequence[Report] | None = handler(robot, command, moment) if handler else None
    status = STATUS_FAILED if extra is None else STATUS_OK
    return [*(extra or ()), CommandResult(moment.time_s, command.type, command.name or "", status)]


def _zoom(robot: Robot, command: Set, time_s: float) -> Report:
    """Zoom the cameras of a name, or all; the omni camera's law is fixed: it says so by Failed."""
    wished = command.parse_fov_rad() or 0.0
    cameras = [
        CameraFov(c.name, c.zoom(wished))
        for c in robot.perspective_cameras
        if _matches_name(command, c.name)
    ]
    omni = robot.omni_camera
    if omni and _matches_name(command, omni.name) and (command.name or not cameras):
        cameras.append(CameraFov(omni.name, omni.capture_fov_rad, STATUS_FAILED))
    if not cameras:
        return CommandResult(time_s, command.type, command.name or "", STATUS_FAILED)
    return CameraResult(time_s, tuple(cameras))


def _reset_odometry(robot: Robot, command: Set, moment: SensorContext) -> list[Report] | None:
    found = [s for s in robot.sensors if isinstance(s, OdometrySensor)]
    meant = [sensor for sensor in found if _matches_name(command, sensor.name)]
    for sensor in meant:
        sensor.reset()
    return [] if meant else None


def _reset_encoder(robot: Robot, command: Set, moment: SensorContext) -> list[Report] | None:
    banks = [s for s in robot.sensors if isinstance(s, EncoderBank)]
    return [] if any([bank.reset(command.name, moment) for bank in banks]) else None


def _set_ins_pose(robot: Robot, command: Set, moment: SensorContext) -> list[Report] | None:
    found = [
        s for s in robot.sensors if isinstance(s, InsSensor) and _matches_name(command, s.name)
    ]
    numbers = command.numeric_params()
    if len(numbers) != 6:
        return None
    x, y, z, roll, pitch, yaw = numbers
    for sensor in found:
        sensor.set_pose((x, y, z), (roll, pitch, yaw), moment.world_from_robot)
    return [] if found else None


def _scan(robot: Robot, command: Set, moment: SensorContext) -> list[Report] | None:
    found = [s for s in robot.sensors if isinstance(s, RangeScannerSensor)]
    scans: list[Report] = [s.read(moment) for s in found if _matches_name(command, s.name)]
    return scans or None


def _set_max_error(robot: Robot, command: Set, moment: SensorContext) -> list[Report] | None:
    return _set_accuracy_target(robot, command, "max_error_px")


def _set_budget(robot: Robot, command: Set, moment: SensorContext) -> list[Report] | None:
    return _set_accuracy_target(robot, command, "budget_ms")


def _set_accuracy_target(robot: Robot, command: Set, field: str) -> list[Report] | None:
    """Turn the dial of the omni camera: how far off its pictures may be, or how long they take."""
    omni, numbers = robot.omni_camera, command.numeric_params()
    if omni is None or not _matches_name(command, omni.name) or len(numbers) != 1:
        return None
    try:
        omni.set_accuracy_target(**{field: numbers[0]})
    except DomainError:
        return None
    return []


# By type and opcode in lower case; a handler returns what it reports, None if it failed.
_HANDLERS: dict[tuple[str, str], Callable[[Robot, Set, SensorContext], list[Report] | None]] = {
    ("odometry", "reset"): _reset_odometry,
    ("encoder", "reset"): _reset_encoder,
    ("ins", "pose"): _set_ins_pose,
    ("rangescanner", "scan"): _scan,
    ("camera", "maxerror"): _set_max_error,
    ("camera", "budget"): _set_budget,
}


def _matches_name(command: Set, name: str) -> bool:
    return command.name is None or command.name.lower() == name.lower()
