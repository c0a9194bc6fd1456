"""A mission package on a robot: joints under command, and what they report."""

from __future__ import annotations

from catoptra_protocol.usarsim.reports import (
    LinkConfiguration,
    LinkGeometry,
    LinkStatus,
    MissionPackageConfiguration,
    MissionPackageGeometry,
    MissionPackageStatus,
)
from catoptra_server.robot.joint_chain import (
    Joint,
    LinkDescription,
    MissionPackageDescription,
)


class MissionPackage:
    """One package of one robot."""

    type = "MisPkg"

    def __init__(self, description: MissionPackageDescription) -> None:
        self.name = description.name
        self._description = description
        self._joints = [Joint(link) for link in description.links]

    def joint_angles_rad(self) -> dict[str, float]:
        """Return radians of each joint by its link's name in lower case."""
        return {joint.link.name.lower(): joint.angle_rad for joint in self._joints}

    def list_joint_angles(self) -> list[tuple[str, float]]:
        """Return each joint's name, as the file spells it, and radians, in order."""
        return [(joint.link.name, joint.angle_rad) for joint in self._joints]

    def find_link_number(self, name: str) -> int | None:
        """Return the link of a name, its own or `Package_LinkN`; None if it is none of ours."""
        for number, link in enumerate(self._description.links, 1):
            if name.lower() in (link.name.lower(), f"{self.name}_link{number}".lower()):
                return number
        return None

    def command_joint(self, number: int, value: float, order: int) -> bool:
        """Command the joint of a link, counted from 1; return whether there is one."""
        if not 1 <= number <= len(self._joints):
            return False
        self._joints[number - 1] = self._joints[number - 1].apply_command(value, order)
        return True

    def step(self, duration_s: float) -> None:
        """Let the joints go on for a time."""
        self._joints = [joint.step(duration_s) for joint in self._joints]

    def status(self, time_s: float) -> MissionPackageStatus:
        """Return where the joints are. A moving one pulls with its whole torque, one at rest not.

        The real capture has -20.00 at rest, what its engine needed to hold the camera; ours has no
        weight.
        """
        links = tuple(
            LinkStatus(number, joint.angle_rad, joint.torque)
            for number, joint in enumerate(self._joints, 1)
        )
        return MissionPackageStatus(time_s, self.name, links)

    def configuration(self) -> MissionPackageConfiguration:
        """Return what the joints can do."""
        links = enumerate(self._description.links, 1)
        return MissionPackageConfiguration(
            self.name, tuple(_link_configuration(n, link) for n, link in links)
        )

    def geometry(self) -> MissionPackageGeometry:
        """Return where the joints sit."""
        links = (
            LinkGeometry(number, link.parent, link.position_m, link.rotation_rad)
            for number, link in enumerate(self._description.links, 1)
        )
        return MissionPackageGeometry(self.name, tuple(links))


def _link_configuration(number: int, link: LinkDescription) -> LinkConfiguration:
    limits = (link.min_rad, link.max_rad) if link.min_rad <= link.max_rad else None
    return LinkConfiguration(number, link.max_speed_rad_s, link.max_torque, limits)
