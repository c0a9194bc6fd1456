"""Touch sensors: pressed at a wall, not before it."""

from __future__ import annotations

import dataclasses

import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.simulation.robot_description import Mount
from helpers.robots import TOUCH, make_instrument
from helpers.room_ray_caster import context_in_room

FRONT = dataclasses.replace(TOUCH, mount=Mount((0.25, 0.0, 0.0)))


@pytest.mark.parametrize(("gap_m", "pressed"), [(0.0001, True), (0.002, False), (1.0, False)])
def test_switch_when_at_a_wall_is_pressed(gap_m: float, pressed: bool) -> None:
    moment = context_in_room(pose=Pose.from_rpy((4.0 - 0.25 - gap_m, 0.0, 0.0)))
    assert make_instrument(FRONT).read(moment).items == (("Touch", pressed),)


def test_line_when_sent_has_the_form_of_the_capture() -> None:
    line = line_from_report(make_instrument(FRONT).read(context_in_room()))
    assert line == b"SEN {Type Touch} {Name Touch Touch False}\r\n"
