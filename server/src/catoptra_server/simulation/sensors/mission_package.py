"""A mission package on a robot: joints under command, and their reports."""

from __future__ import annotations

from catoptra_protocol.usarsim.reports import (
    LinkConfiguration,
    LinkGeometry,
    LinkStatus,
    MissionPackageConfiguration,
    MissionPackageGeometry,
    MissionPackageStatus,
)
from catoptra_server.simulation.robot_description import (
    Joint,
    LinkDescription,
    MissionPackageDescription,
)


class MissionPackage:
    """Joints of one package of one robot."""

    type = "MisPkg"

    def __init__(self, description: MissionPackageDescription) -> None:
        self.name = description.name
        self._description = description
        self._joints = [Joint(link) for link in description.links]

    def joint_angles_rad(self) -> dict[str, float]:
        """Angle of each joint by link name in lower case."""
        # Lower case: mounts and encoders name links in any case.
        return {joint.link.name.lower(): joint.angle_rad for joint in self._joints}

    def list_joint_angles(self) -> list[tuple[str, float]]:
        """Name, as the file spells it, and angle in radians of each joint, in order."""
        return [(joint.link.name, joint.angle_rad) for joint in self._joints]

    def find_link_number(self, name: str) -> int | None:
        """Number of a link, by its own name or as `Package_LinkN`; None for an unknown name."""
        for number, link in enumerate(self._description.links, 1):
            if name.lower() in (link.name.lower(), f"{self.name}_link{number}".lower()):
                return number
        return None

    def command_joint(self, number: int, value: float, order: int) -> bool:
        """Command the joint of a link.

        Args:
            number: Number of the link, from 1.
            value: Angle or speed.
            order: Kind of the command, a constant of `simulation/robot_description.py`.

        Returns:
            Whether such a link exists.
        """
        if not 1 <= number <= len(self._joints):
            return False
        # Joints are immutable: a command makes another one.
        self._joints[number - 1] = self._joints[number - 1].apply_command(value, order)
        return True

    def step(self, duration_s: float) -> None:
        """Move all joints for a time."""
        self._joints = [joint.step(duration_s) for joint in self._joints]

    def status(self, time_s: float) -> MissionPackageStatus:
        """MISSTA: angle and torque of each joint."""
        # A capture of a real server has a torque of -20.00 at rest, the load of the camera; loads
        # are not simulated, so the torque at rest is 0 here.
        links = tuple(
            LinkStatus(number, joint.angle_rad, joint.torque)
            for number, joint in enumerate(self._joints, 1)
        )
        return MissionPackageStatus(time_s, self.name, links)

    def configuration(self) -> MissionPackageConfiguration:
        """CONF: speeds, torques and limits of the joints."""
        links = enumerate(self._description.links, 1)
        return MissionPackageConfiguration(
            self.name, tuple(_link_configuration(n, link) for n, link in links)
        )

    def geometry(self) -> MissionPackageGeometry:
        """GEO: parent and pose of each joint."""
        links = (
            LinkGeometry(number, link.parent, link.position_m, link.rotation_rad)
            for number, link in enumerate(self._description.links, 1)
        )
        return MissionPackageGeometry(self.name, tuple(links))


def _link_configuration(number: int, link: LinkDescription) -> LinkConfiguration:
    # Without limits the range is inverted, and CONF has no limits to report.
    limits = (link.min_rad, link.max_rad) if link.min_rad <= link.max_rad else None
    return LinkConfiguration(number, link.max_speed_rad_s, link.max_torque, limits)
