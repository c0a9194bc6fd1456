"""All checks of the control port."""

from __future__ import annotations

from conformance.check import Check, ServerUnderTest, check_from_function
from conformance.control_command_checks import COMMAND_CHECKS
from conformance.control_motion_checks import MOTION_CHECKS
from conformance.control_range_checks import RANGE_CHECKS
from conformance.control_session import spawn_robot
from conformance.control_text_checks import TEXT_CHECKS
from conformance.control_tour_checks import TOUR_ROWS


def check_spawn(server: ServerUnderTest) -> None:
    """INIT with a class and a pose, without a name, spawns a robot that reports."""
    with spawn_robot(server):
        pass


SPAWN_CHECK = check_from_function("spawn", "control", check_spawn, needs_robot=False)
CONTROL_CHECKS: tuple[Check, ...] = (
    SPAWN_CHECK,
    *TEXT_CHECKS,
    *MOTION_CHECKS,
    *COMMAND_CHECKS,
    *RANGE_CHECKS,
    *TOUR_ROWS,
)
