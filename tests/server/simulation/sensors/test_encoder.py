"""Encoders: ticks of wheels and joints."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.usarsim.reports import line_from_report
from catoptra_server.simulation.drive import WheelTravel
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.simulation.sensors import MotionStep, SensorContext
from catoptra_server.simulation.sensors.encoder import EncoderBank, EncoderDescription
from helpers.robots import ENCODER, make_instrument

RIGHT = dataclasses.replace(ENCODER, name="ECRight", shaft="right")
PAN = dataclasses.replace(ENCODER, name="ECPan", shaft="CameraPan")
NOW = SensorContext(1.0, 0, Pose.identity())


def make_bank(*encoders: EncoderDescription) -> EncoderBank:
    bank: EncoderBank = make_instrument(*(encoders or (ENCODER, RIGHT)))
    return bank


def roll(encoders: EncoderBank, left_m: float, right_m: float) -> EncoderBank:
    encoders.update(MotionStep(WheelTravel(left_m, right_m), 0, 0.02, PlanarPose(0.0, 0.0, 0.0)))
    return encoders


def test_ticks_when_rolled_are_the_angle_over_the_resolution() -> None:
    # 0.52 m on a wheel of 0.13 m are 4 rad: 229 whole ticks of 0.01745.
    items = roll(make_bank(), 0.52, -0.26).read(NOW).items
    assert items == (("ECLeft", int(4.0 / 0.01745)), ("ECRight", -int(2.0 / 0.01745)))


def test_line_when_sent_has_all_encoders() -> None:
    line = line_from_report(roll(make_bank(), 0.13, 0.0).read(NOW))
    assert line == b"SEN {Type Encoder} {Name ECLeft Tick 57} {Name ECRight Tick 0}\r\n"


def test_ticks_when_of_a_joint_follow_its_angle() -> None:
    turned = SensorContext(1.0, 0, Pose.identity(), joint_angles_rad={"camerapan": 0.5})
    assert make_bank(PAN).read(turned).items == (("ECPan", 28),)
    assert make_bank(PAN).read(NOW).items == (("ECPan", 0),)


@pytest.mark.parametrize(("name", "left", "right"), [(None, 0, 0), ("ecleft", 0, 57)])
def test_reset_when_sent_counts_from_here(name: str | None, left: int, right: int) -> None:
    encoders = roll(make_bank(), 0.13, 0.13)
    assert encoders.reset(name, NOW)
    assert [ticks for _, ticks in encoders.read(NOW).items] == [left, right]


def test_reset_without_such_an_encoder_fails() -> None:
    assert not make_bank().reset("Other", NOW)


def test_noise_when_configured_moves_the_ticks_by_its_spread() -> None:
    encoders = roll(make_bank(dataclasses.replace(ENCODER, noise_rad=0.1)), 0.52, 0.0)
    ticks = [encoders.read(SensorContext(0.0, t, Pose.identity())).items[0][1] for t in range(400)]
    # 0.1 rad are 5.73 ticks; whole ticks add little.
    assert np.std(ticks) == pytest.approx(5.73, rel=0.12)
