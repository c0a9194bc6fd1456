"""Joints: orders, speeds, limits."""

from __future__ import annotations

import dataclasses

import pytest

from catoptra_server.simulation.robot_description import (
    ANGLE,
    BRAKE,
    RELATIVE_ANGLE,
    RELATIVE_SPEED,
    SPEED,
    Joint,
    LinkDescription,
)

LINK = LinkDescription("Pan", -1, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.5, 20.0)
LINK_WITH_LIMITS = dataclasses.replace(LINK, min_rad=-0.2, max_rad=0.3)


def run_commands(link: LinkDescription, seconds: float, *commands: tuple[float, int]) -> Joint:
    joint = Joint(link)
    for value, order in commands:
        joint = joint.apply_command(value, order).step(seconds)
    return joint


@pytest.mark.parametrize(
    ("link", "commands", "angle"),
    [
        (LINK, [(0.4, ANGLE)], 0.4),
        (LINK, [(4.0, ANGLE)], 0.5),
        (LINK, [(-4.0, ANGLE)], -0.5),
        (LINK, [(0.4, ANGLE), (0.1, RELATIVE_ANGLE)], 0.5),
        (LINK, [(-0.3, SPEED)], -0.3),
        (LINK, [(9.0, SPEED)], 0.5),
        (LINK, [(0.2, SPEED), (0.1, RELATIVE_SPEED)], 0.5),
        (LINK, [(0.2, SPEED), (0.0, BRAKE)], 0.2),
        (LINK, [(0.2, SPEED), (0.0, SPEED)], 0.2),
        (LINK, [(5.0, 2)], 0.0),
        (LINK, [(5.0, 99)], 0.0),
        (LINK_WITH_LIMITS, [(9.0, ANGLE)], 0.3),
        (LINK_WITH_LIMITS, [(-9.0, SPEED)], -0.2),
    ],
)
def test_joint_when_commanded_is_there_after_a_second_each(
    link: LinkDescription, commands: list[tuple[float, int]], angle: float
) -> None:
    assert run_commands(link, 1.0, *commands).angle_rad == pytest.approx(angle)


def test_torque_of_a_moving_joint_is_the_maximum() -> None:
    assert Joint(LINK).apply_command(-1.0, ANGLE).torque == -20.0
    assert Joint(LINK).torque == 0.0
