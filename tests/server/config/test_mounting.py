"""Mounts of robot files: metres, Unreal units, parents."""

from __future__ import annotations

import math

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.camera_sections import read_mount
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.unreal_ini import parse_sections

ITEM = "Item=(Position=(X=25,Y=0,z=-50),Direction=(Y=0,Z=16384,X=0){})"


def make_robot_section(*lines: str) -> SectionReader:
    (section,) = parse_sections("\n".join(("[R]", *lines)), file="x.ini")
    return SectionReader(section.name, section.where, section.entries)


def test_mount_when_plain_is_in_metres_on_the_chassis() -> None:
    robot = make_robot_section(ITEM.format(""))
    mount = read_mount(robot, robot.get_struct("Item"))
    assert (mount.position_m, mount.parent) == ((25.0, 0.0, -50.0), "HARD")


def test_mount_when_by_uu_is_turned_into_metres_and_radians() -> None:
    robot = make_robot_section(ITEM.format(',Parent="CameraTilt"'), "bMountByUU=True")
    mount = read_mount(robot, robot.get_struct("Item"))
    assert mount.position_m == pytest.approx((0.1, 0.0, -0.2))
    assert mount.rotation_rad == pytest.approx((0.0, 0.0, math.pi / 2))
    assert mount.parent == "CameraTilt"


@pytest.mark.parametrize("x", ["101", "-1e5", "1e9"])
def test_mount_when_far_from_the_robot_is_rejected(x: str) -> None:
    robot = make_robot_section(f"Item=(Position=(X=0,Y={x}))")
    with pytest.raises(ConfigError, match=r"x\.ini:2: .*Position=.*within 100 m of its parent"):
        read_mount(robot, robot.get_struct("Item"))
