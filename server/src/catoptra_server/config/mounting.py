"""Where items of a robot's section are mounted: metres and radians, or if asked Unreal units."""

from __future__ import annotations

from catoptra_protocol.optics.units import metres_from_uu, radians_from_uu
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.robot.mount import CHASSIS, Mount


def read_mount(robot: SectionReader, item: SectionReader, key: str = "Position") -> Mount:
    """Return the mount of an item of a robot's section; without a Parent it is the chassis."""
    position, direction = (
        item.get_vector(key, (0.0, 0.0, 0.0)),
        item.get_vector("Direction", (0.0, 0.0, 0.0)),
    )
    if robot.get_bool("bMountByUU", False):
        x, y, z = (metres_from_uu(value) for value in position)
        roll, pitch, yaw = (radians_from_uu(value) for value in direction)
        position, direction = (x, y, z), (roll, pitch, yaw)
    return Mount(position, direction, item.get_wire_name("Parent", CHASSIS) or CHASSIS)
