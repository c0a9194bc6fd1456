"""Mounts of the items of a robot's section, in SI units whatever the file's units."""

from __future__ import annotations

from catoptra_protocol.optics.units import metres_from_uu, radians_from_uu
from catoptra_protocol.usarsim.geometry import CHASSIS_MOUNT
from catoptra_server.config.section_reader import SectionReader, Vector
from catoptra_server.simulation.robot_description import Mount

# The largest body that a file may describe.
MAX_OFFSET_M = 100.0


def read_mount(robot: SectionReader, item: SectionReader, key: str = "Position") -> Mount:
    """Mount of an item, relative to its Parent or, without one, to the chassis.

    Args:
        robot: the robot's section, whose bMountByUU switches to Unreal units.
        item: the item's struct.
        key: name of the position's key.

    Raises:
        ConfigError: A position far from the robot.
    """
    position, direction = (
        item.get_vector(key, (0.0, 0.0, 0.0)),
        item.get_vector("Direction", (0.0, 0.0, 0.0)),
    )
    # UT2004's own switch: 250 Unreal units to the metre, 65536 to the turn.
    if robot.get_bool("bMountByUU", False):
        x, y, z = (metres_from_uu(value) for value in position)
        roll, pitch, yaw = (radians_from_uu(value) for value in direction)
        position, direction = (x, y, z), (roll, pitch, yaw)
    require_on_robot(item, key, position)
    parent = item.get_wire_name("Parent", CHASSIS_MOUNT) or CHASSIS_MOUNT
    return Mount(position, direction, parent)


def require_on_robot(item: SectionReader, key: str, position_m: Vector) -> None:
    """Check that a position is near the robot that has it.

    Raises:
        ConfigError: The position is more than MAX_OFFSET_M away in some direction.
    """
    if max(map(abs, position_m)) > MAX_OFFSET_M:
        raise item.make_error(key, expected=f"a position within {MAX_OFFSET_M:g} m of its parent")
