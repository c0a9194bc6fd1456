"""SET: what a part of a robot can be told, and the RES that confirms it or says Failed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from catoptra_protocol.errors import DomainError
from catoptra_protocol.wire.commands import Set
from catoptra_protocol.wire.reports import (
    CameraFov,
    CameraResult,
    Report,
    Result,
)
from catoptra_protocol.wire.results import FAILED, OK
from catoptra_server.sensors import Moment
from catoptra_server.sensors.encoder import EncoderBank
from catoptra_server.sensors.ins import InsSensor
from catoptra_server.sensors.odometry import OdometrySensor
from catoptra_server.sensors.range_scanner import RangeScannerSensor
from catoptra_server.simulation.spawned_robot import SpawnedRobot


def obey_set(robot: SpawnedRobot, command: Set, moment: Moment) -> list[Report]:
    """Carry out SET of a part; return its RES, after the reading that SCAN asks for."""
    if command.type.lower() == "camera" and command.wanted_fov_rad() is not None:
        return [_zoomed(robot, command, moment.time_s)]
    handler = _HANDLERS.get((command.type.lower(), (command.opcode or "").lower()))
    extra: Sequence[Report] | None = handler(robot, command, moment) if handler else None
    status = FAILED if extra is None else OK
    return [*(extra or ()), Result(moment.time_s, command.type, command.name or "", status)]


def _zoomed(robot: SpawnedRobot, command: Set, time_s: float) -> Report:
    """Zoom the cameras of a name, or all; the omni camera's law is fixed: it says so by Failed."""
    wished = command.wanted_fov_rad() or 0.0
    cameras = [
        CameraFov(c.name, c.zoom(wished)) for c in robot.cameras if _is_meant(command, c.name)
    ]
    omni = robot.camera
    if omni and _is_meant(command, omni.name) and (command.name or not cameras):
        cameras.append(CameraFov(omni.name, omni.capture_fov_rad, FAILED))
    if not cameras:
        return Result(time_s, command.type, command.name or "", FAILED)
    return CameraResult(time_s, tuple(cameras))


def _reset_odometry(robot: SpawnedRobot, command: Set, moment: Moment) -> list[Report] | None:
    found = [s for s in robot.sensors if isinstance(s, OdometrySensor)]
    meant = [sensor for sensor in found if _is_meant(command, sensor.name)]
    for sensor in meant:
        sensor.reset()
    return [] if meant else None


def _reset_encoder(robot: SpawnedRobot, command: Set, moment: Moment) -> list[Report] | None:
    banks = [s for s in robot.sensors if isinstance(s, EncoderBank)]
    return [] if any([bank.reset(command.name, moment) for bank in banks]) else None


def _correct_ins(robot: SpawnedRobot, command: Set, moment: Moment) -> list[Report] | None:
    found = [s for s in robot.sensors if isinstance(s, InsSensor) and _is_meant(command, s.name)]
    numbers = command.numbers()
    if len(numbers) != 6:
        return None
    x, y, z, roll, pitch, yaw = numbers
    for sensor in found:
        sensor.correct((x, y, z), (roll, pitch, yaw), moment.world_from_robot)
    return [] if found else None


def _scan(robot: SpawnedRobot, command: Set, moment: Moment) -> list[Report] | None:
    found = [s for s in robot.sensors if isinstance(s, RangeScannerSensor)]
    scans: list[Report] = [s.reading(moment) for s in found if _is_meant(command, s.name)]
    return scans or None


def _set_max_error(robot: SpawnedRobot, command: Set, moment: Moment) -> list[Report] | None:
    return _turn_dial(robot, command, "max_error_px")


def _set_budget(robot: SpawnedRobot, command: Set, moment: Moment) -> list[Report] | None:
    return _turn_dial(robot, command, "budget_ms")


def _turn_dial(robot: SpawnedRobot, command: Set, name: str) -> list[Report] | None:
    """Turn the dial of the omni camera: how far off its pictures may be, or how long they take."""
    omni, numbers = robot.camera, command.numbers()
    if omni is None or not _is_meant(command, omni.name) or len(numbers) != 1:
        return None
    try:
        omni.turn_dial(**{name: numbers[0]})
    except DomainError:
        return None
    return []


# By type and opcode in lower case; a handler returns what it reports, None if it failed.
_HANDLERS: dict[tuple[str, str], Callable[[SpawnedRobot, Set, Moment], list[Report] | None]] = {
    ("odometry", "reset"): _reset_odometry,
    ("encoder", "reset"): _reset_encoder,
    ("ins", "pose"): _correct_ins,
    ("rangescanner", "scan"): _scan,
    ("camera", "maxerror"): _set_max_error,
    ("camera", "budget"): _set_budget,
}


def _is_meant(command: Set, name: str) -> bool:
    return command.name is None or command.name.lower() == name.lower()
