"""Where items of a robot's section are mounted: metres and radians, or if asked Unreal units."""

from __future__ import annotations

from catoptra_protocol.optics.units import metres_from_uu, radians_from_uu
from catoptra_server.config.settings import Settings
from catoptra_server.robot.mount import CHASSIS, Mount


def mount_of(robot: Settings, item: Settings, key: str = "Position") -> Mount:
    """Return the mount of an item of a robot's section; without a Parent it is the chassis."""
    position, direction = (
        item.vector(key, (0.0, 0.0, 0.0)),
        item.vector("Direction", (0.0, 0.0, 0.0)),
    )
    if robot.boolean("bMountByUU", False):
        x, y, z = (metres_from_uu(value) for value in position)
        roll, pitch, yaw = (radians_from_uu(value) for value in direction)
        position, direction = (x, y, z), (roll, pitch, yaw)
    return Mount(position, direction, item.word("Parent", CHASSIS) or CHASSIS)
