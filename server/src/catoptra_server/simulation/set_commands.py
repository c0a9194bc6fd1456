"""SET of a robot's parts, and the RES that reports OK or Failed.

To add an opcode: a handler below, and its line in `_HANDLERS`.
"""

from __future__ import annotations

from collections.abc import Callable

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


def execute_set(robot: Robot, command: Set, context: SensorContext) -> list[Report]:
    """Execute SET of a part.

    Returns:
        The readings that the command requests, such as the scan of SCAN, then the RES.
    """
    # SET Camera FOV carries its value in place of an opcode, and has a RES of its own form.
    if command.type.lower() == "camera" and command.parse_fov_rad() is not None:
        return [_zoom(robot, command, context.time_s)]
    handler = _HANDLERS.get((command.type.lower(), (command.opcode or "").lower()))
    readings = handler(robot, command, context) if handler else None
    status = STATUS_FAILED if readings is None else STATUS_OK
    result = CommandResult(context.time_s, command.type, command.name or "", status)
    return [*(readings or ()), result]


def _zoom(robot: Robot, command: Set, time_s: float) -> Report:
    """Zoom the perspective camera of a name, or all of them."""
    requested = command.parse_fov_rad() or 0.0
    cameras = [
        CameraFov(c.name, c.zoom(requested))
        for c in robot.perspective_cameras
        if _matches_name(command, c.name)
    ]
    # Mirror and lens fix an omnidirectional camera's model. The camera fails by name, or where the
    # robot has no other, but does not spoil a zoom of all perspective cameras.
    if command.name or not cameras:
        cameras += [
            CameraFov(omni.name, omni.capture_fov_rad, STATUS_FAILED)
            for omni in robot.omni_cameras
            if _matches_name(command, omni.name)
        ]
    if not cameras:
        return CommandResult(time_s, command.type, command.name or "", STATUS_FAILED)
    return CameraResult(time_s, tuple(cameras))


def _reset_odometry(robot: Robot, command: Set, context: SensorContext) -> list[Report] | None:
    found = [
        s for s in robot.sensors if isinstance(s, OdometrySensor) and _matches_name(command, s.name)
    ]
    for sensor in found:
        sensor.reset()
    return [] if found else None


def _reset_encoder(robot: Robot, command: Set, context: SensorContext) -> list[Report] | None:
    banks = [s for s in robot.sensors if isinstance(s, EncoderBank)]
    # A list inside any(): every bank is reset, not only the first that has the name.
    return [] if any([bank.reset(command.name, context) for bank in banks]) else None


def _set_ins_pose(robot: Robot, command: Set, context: SensorContext) -> list[Report] | None:
    found = [
        s for s in robot.sensors if isinstance(s, InsSensor) and _matches_name(command, s.name)
    ]
    numbers = command.numeric_params
    # x, y, z, roll, pitch, yaw; a part of a pose is no pose.
    if len(numbers) != 6:
        return None
    x, y, z, roll, pitch, yaw = numbers
    for sensor in found:
        sensor.set_pose((x, y, z), (roll, pitch, yaw), context.world_from_robot)
    return [] if found else None


def _scan(robot: Robot, command: Set, context: SensorContext) -> list[Report] | None:
    found = [s for s in robot.sensors if isinstance(s, RangeScannerSensor)]
    # Beside the periodic scans, whose schedule does not change.
    scans: list[Report] = [s.read(context) for s in found if _matches_name(command, s.name)]
    return scans or None


def _set_max_error(robot: Robot, command: Set, context: SensorContext) -> list[Report] | None:
    return _set_accuracy_target(robot, command, "max_error_px")


def _set_budget(robot: Robot, command: Set, context: SensorContext) -> list[Report] | None:
    return _set_accuracy_target(robot, command, "budget_ms")


def _set_accuracy_target(robot: Robot, command: Set, field: str) -> list[Report] | None:
    """Set one value of an accuracy target, of all omnidirectional cameras without a name."""
    omnis = [omni for omni in robot.omni_cameras if _matches_name(command, omni.name)]
    numbers = command.numeric_params
    if not omnis or len(numbers) != 1:
        return None
    try:
        for omni in omnis:
            omni.set_accuracy_target(**{field: numbers[0]})
    # A negative value, which SET reports by Failed instead of an error.
    except DomainError:
        return None
    return []


# By type and opcode in lower case. A handler returns the requested readings, None for Failed.
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
